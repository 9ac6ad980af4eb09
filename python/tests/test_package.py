"""The package against its promises: shapes, errors, bits equal to the program's, examples."""

import json
import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import robert_studio as rs

REPOSITORY = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((REPOSITORY / "examples/python").glob("*.py"))


@pytest.fixture(scope="module")
def take():
    return rs.rollout(rs.Clip.task("ur5e/reacher"), "pd", seed=5)


def binary():
    """The program, where it was built: ROBERT_BIN, or in target."""
    named = os.environ.get("ROBERT_BIN")
    built = [REPOSITORY / "target" / profile / "robert" for profile in ("release", "debug")]
    found = [Path(named)] if named else [p for p in built if p.is_file()]
    if not found:
        pytest.skip("the program is not built")
    return found[0]


def same_bits(clip, folder, *options, **arguments):
    """Asserts that the program and the package perform a clip with the same bytes as takes."""
    clip.save(folder / "same.clip.json")
    theirs = [binary(), "rollout", folder / "same.clip.json", "--out", folder / "theirs.mcap", "-q", *options]
    subprocess.run(theirs, check=True, stdout=subprocess.DEVNULL)
    rs.rollout(clip, **arguments).save(folder / "ours.mcap")
    assert (folder / "theirs.mcap").read_bytes() == (folder / "ours.mcap").read_bytes()


def test_robots_have_shapes_and_names():
    assert "ur5e" in rs.Robot.builtin()
    robot = rs.Robot("shadow_hand")
    assert robot.home().shape == (len(robot.joints),) == (22,)
    assert robot.ranges.shape == (22, 2) and robot.ctrl_ranges.shape == (len(robot.actuators), 2)
    assert any(p["default"] for p in robot.policies())
    with pytest.raises(rs.RobertError, match="nobody"):
        rs.Robot("nobody")


def test_a_robot_is_imported_with_the_options_of_the_program(tmp_path):
    (tmp_path / "models").mkdir()
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/cup.xml").write_text(
        '<mujocoinclude><body name="cup" pos="1 0 0"><freejoint/><geom size=".03"/></body></mujocoinclude>'
    )
    model = tmp_path / "models/arm.xml"
    model.write_text(
        """<mujoco><compiler angle="radian" autolimits="true"/><worldbody>
        <body name="upper"><joint name="shoulder" axis="0 1 0" range="-1 1"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>
        <body name="lower" pos=".3 0 0"><joint name="elbow" axis="0 1 0" range="-1 1"/>
        <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/></body></body><include file="../parts/cup.xml"/></worldbody>
        <actuator><motor joint="shoulder" ctrlrange="-20 20"/><motor joint="elbow" ctrlrange="-9 9"/></actuator></mujoco>"""
    )
    # The include is outside the model's own folder.
    with pytest.raises(rs.InvalidInput):
        rs.import_robot(model, tmp_path / "refused")
    told = rs.import_robot(model, tmp_path / "arm", root=tmp_path, without=["cup"], weld="elbow", drives="file")
    robot = rs.Robot(tmp_path / "arm")
    assert robot.joints == ["shoulder"]
    assert "damping" not in (tmp_path / "arm/robot.xml").read_text(), told
    rs.import_robot(model, tmp_path / "both", root=tmp_path, without="cup", without_meshes=True)
    assert rs.Robot(tmp_path / "both").joints == ["shoulder", "elbow"]
    assert "damping" in (tmp_path / "both/robot.xml").read_text()
    with pytest.raises(ValueError, match="modelled or file"):
        rs.import_robot(model, tmp_path / "never", root=tmp_path, drives="none")


def test_a_clip_is_authored_saved_and_read(tmp_path):
    clip = rs.Clip.new("ur5e", 41, name="nod")
    home = clip.robot.home()
    clip.key(0, home).key(20, home + 0.2, hold=3, fill="linear").key(40, home).mask(25, 30)
    goals, seen = clip.command()
    assert goals.shape == seen.shape == (41, 5)
    assert seen[20:23].all() and not seen[25:30].any() and not seen[1:20].any()
    clip.save(tmp_path / "nod.clip.json")
    assert rs.Clip.load(tmp_path / "nod.clip.json").text() == clip.text()
    before = clip.text()
    with pytest.raises(rs.InvalidInput):
        clip.key(99, home)
    assert clip.text() == before, "a refused edit leaves the clip as it was"
    with pytest.raises(ValueError, match="cubic"):
        clip.fill("wobble")


def test_end_effector_goals_are_solved_and_performed_as_by_the_program(tmp_path):
    square = rs.Clip.load(REPOSITORY / "examples/clips/square.clip.json")
    goals, seen = square.command()
    assert seen.all() and np.abs(np.diff(goals, axis=0)).max() > 0.01
    path = tmp_path / "goals.csv"
    subprocess.run([binary(), "clip", "convert", REPOSITORY / "examples/clips/square.clip.json", path], check=True)
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    assert np.abs(table[:, -5:] - goals).max() < 1e-6
    same_bits(square, tmp_path, "-p", "pd", policy="pd")
    assert rs.evaluate({"square": square}, ["pd"], floors=False)[0]["precision"] < 0.05
    with pytest.raises(rs.InvalidInput, match="end_effector"):
        rs.Clip.new("pointmass", 9).reach(4, "end_effector", [0, 0, 0])


def test_goals_and_slopes_are_authored(tmp_path):
    clip = rs.Clip.new("ur5e", 61)
    home = clip.robot.home()
    clip.key(0, home, fill="cubic").key(20, home + 0.2, fill="cubic").reach(60, "end_effector", np.array([0.42, 0.06, 1.95]))
    assert clip.keys == [0, 20, 60] and clip.command()[1][60].all()
    before = clip.command()[0]
    clip.apply("tangent.set", frames=[20], joints=["elbow"], tangent=0.5)
    assert np.abs(clip.command()[0] - before).max() > 1e-3
    assert '"tangents"' in clip.text() and '"reach"' in clip.text()
    same_bits(clip, tmp_path, "-p", "computed-torque", policy="computed-torque")
    with pytest.raises(ValueError, match="keys.bake"):
        clip.apply("keys.wobble")
    with pytest.raises(rs.InvalidInput, match="no key at frame 7"):
        clip.apply("keys.set", frame=7, q=home)
    # A joint without a value at a key is led past it by the curve of its own neighbours, here from frame 0 to 60.
    through = clip.command()[0][20, 1]
    clip.apply("keys.set", frame=20, q=np.array([0.1, np.nan, 0, 0, 0]))
    values, commanded = clip.command()
    assert commanded[20].all() and abs(values[20, 1] - through) > 0.05
    # Without a curve that joint is free there.
    clip.apply("fill.set", frames=[0], fill="mask")
    assert not clip.command()[1][20, 1]


def test_arrays_become_clips():
    wave = 0.3 * np.sin(np.arange(81)[:, None] / 10) * np.ones(5)
    dense, thin = rs.Clip.from_array("ur5e", wave), rs.Clip.from_array("ur5e", wave, tolerance=0.01)
    assert np.abs(dense.command()[0] - wave).max() < 1e-6
    assert len(thin.keys) < 30 and np.abs(thin.command()[0] - wave).max() < 0.011
    wave[10:20] = np.nan
    assert not rs.Clip.from_array("ur5e", wave).command()[1][10:20].any()


def test_errors_have_a_place(tmp_path):
    path = tmp_path / "bad.clip.json"
    path.write_text(rs.Clip.task("ur5e/reacher").text().replace('"frame"', '"farme"', 1))
    with pytest.raises(rs.InvalidInput, match=r"bad\.clip\.json:\d+:\d+"):
        rs.Clip.load(path)
    (tmp_path / "bad.mcap").write_bytes(b"\x89MCAP0\r\nrest")
    with pytest.raises(rs.InvalidInput, match="byte"):
        rs.Take.load(tmp_path / "bad.mcap")


def test_a_take_has_its_arrays(take):
    n = take.frames
    assert take.q.shape == take.qd.shape == take.error.shape == take.command.shape == (n, 5)
    assert take.ctrl.shape == take.action.shape == (n - 1, 5) and take.poses.shape == (n, len(take.bodies), 7)
    assert take.q is take.q and not take.q.flags.writeable
    error = np.abs(take.q - take.command)
    assert np.array_equal(np.isnan(error), np.isnan(take.error))
    assert np.nanmax(np.abs(error - take.error)) < 1e-12
    assert np.isclose(np.nanmean(take.error[1:]), take.precision["precision"], rtol=1e-9)
    with pytest.raises(ValueError):
        take.q[0, 0] = 1.0


def test_takes_have_the_bits_of_the_program(take, tmp_path):
    out = tmp_path / "a.mcap"
    subprocess.run([binary(), "rollout", "ur5e/reacher", "-p", "pd", "--seed", "5", "--out", out, "-q"], check=True)
    take.save(tmp_path / "b.mcap")
    assert out.read_bytes() == (tmp_path / "b.mcap").read_bytes()
    assert np.array_equal(rs.Take.load(out).q, take.q)
    version = subprocess.run([binary(), "--version"], check=True, capture_output=True, text=True).stdout
    assert version.split()[-1] == rs.__version__


def test_the_choice_among_policies_has_the_bits_of_the_program(tmp_path):
    clip = rs.Clip.task("pointmass/circle")
    same_bits(clip, tmp_path)
    same_bits(clip, tmp_path, "--plant", "mass=1.3", plant="mass=1.3")
    assert rs.rollout(clip).precision["precision"] <= rs.rollout(clip, "pd").precision["precision"]


@pytest.mark.parametrize("to", ["glb", "bvh", "usda", "lafan", "npz", "ros", "bag", "ur", "lerobot", "minari"])
def test_exports_have_the_bits_of_the_program(take, tmp_path, to):
    take.save(tmp_path / "reacher.mcap")
    made = rs.export([take], to, tmp_path / "ours", title="reacher")
    assert made["frames"] > 0 and made["meaning"] and made["open"]
    args = [binary(), "export", tmp_path / "reacher.mcap", "--to", to, "-o", tmp_path / "theirs", "--json", "-q"]
    done = json.loads(subprocess.run(args, check=True, capture_output=True).stdout)
    assert len(done["files"]) == len(made["files"])
    for ours, theirs in zip(made["files"], done["files"]):
        assert ours.read_bytes() == Path(theirs).read_bytes(), ours


def test_unknown_options_are_named(take, tmp_path):
    with pytest.raises(TypeError, match="colour"):
        take.export("glb", tmp_path / "a.glb", colour="red")
    with pytest.raises(ValueError, match="fbx"):
        take.export("fbx", tmp_path / "a.fbx")


def test_policies_act_as_the_rollout_does():
    """Frame by frame from outside: the same actions as inside, bit for bit."""
    clip = rs.Clip.from_array("ur5e", 0.2 * np.sin(np.arange(60)[:, None] / 9) * np.ones(5) + rs.Robot("ur5e").home())
    take = rs.rollout(clip, "robert")
    goals, seen = clip.command()
    policy = rs.Policy("ur5e", "robert")
    history = [take.q[0]] * 30 + list(take.q)
    for frame in range(take.frames - 1):
        rows = np.minimum(np.arange(frame + 1, frame + 21), len(goals) - 1)
        action = policy.act(np.array(history[frame : frame + 31]), goals[rows], seen[rows])
        assert np.array_equal(action, take.action[frame]), frame
    with pytest.raises(ValueError, match=r"history is \(3, 5\)"):
        policy.act(np.zeros((3, 5)), np.zeros((20, 5)), np.ones((20, 5), bool))


def test_a_gap_begins_where_the_robot_is():
    """Outside a rollout the goal before the window is unknown, so a joint is led from its own state."""
    robot = rs.Robot("ur5e")
    home = robot.home()
    goals, seen = np.tile(home, (20, 1)), np.zeros((20, 5), bool)
    seen[13] = True
    history = np.tile(home, (31, 1))
    still = rs.Policy("ur5e", "robert").act(history, goals, np.ones((20, 5), bool))
    action = rs.Policy("ur5e", "robert").act(history, goals, seen)
    assert np.abs(action - still).max() < 1e-3


def test_evaluations_are_rows():
    rows = rs.evaluate({"reacher": rs.Clip.task("ur5e/reacher")}, ["pd", "computed-torque"], floors=False)
    assert [r["policy"] for r in rows] == ["pd", "computed-torque"]
    alone = rs.rollout(rs.Clip.task("ur5e/reacher"), "pd").precision["precision"]
    assert rows[0]["precision"] == alone and rows[1]["precision"] < alone


def test_progress_is_told_and_what_it_raises_stops_the_work():
    told = []
    rs.rollout(rs.Clip.task("ur5e/reacher"), "pd", progress=lambda done, total, note: told.append((done, total)))
    assert told and told[-1] == (200, 200)

    def stop(done, total, note):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rs.evaluate(rs.Clip.suite("ur5e", "manual"), ["computed-torque"] * 1, seeds=50, floors=False, progress=stop)


def test_other_threads_run_meanwhile():
    """While one thread simulates, this one counts: the interpreter's lock is free."""
    clip = rs.Clip.task("shadow_hand/fire")
    worker = threading.Thread(target=rs.rollout, args=(clip, "robert"))
    worker.start()
    turns, longest, last = 0, 0.0, time.perf_counter()
    while worker.is_alive():
        now = time.perf_counter()
        turns, longest, last = turns + 1, max(longest, now - last), now
        time.sleep(0.001)
    assert turns > 20 and longest < 0.5, (turns, longest)


def test_data_is_collected_mapped_and_fitted(tmp_path):
    data = rs.collect("pointmass", tmp_path / "data", transitions=3000)
    assert data.frames == 3000 and len(data) == 12
    q, qd, action = data[0]
    assert q.shape == qd.shape == (250, 2) and action.shape == (250, 2) and np.abs(action).max() <= 1
    q, action = next(data.windows(51))
    assert q.shape == (200, 51, 2) and q.base is not None and np.shares_memory(q, data[0][0])
    fitted = rs.fit("ridge", tmp_path / "data")
    take = rs.rollout(rs.Clip.task("pointmass/circle"), f"ridge:{fitted['out']}")
    assert take.precision["precision"] < 0.05
    run = rs.train("pointmass", tmp_path / "data", tmp_path / "run", settings={"steps": 2}, evaluations=1)
    assert run["result"]["step"] == 2
    with pytest.raises(ValueError, match="run already"):
        rs.train("pointmass", tmp_path / "data", tmp_path / "run")


def test_pictures_and_pages(take):
    picture = take.render(20, size=(160, 120))
    assert picture.shape == (120, 160, 3) and picture.dtype == np.uint8 and picture.std() > 5
    assert take.render([0, 5], size=(64, 48)).shape == (2, 48, 64, 3)
    try:
        page = take.html()
    except rs.MissingDependency:
        pytest.skip("the viser client is not in this build")
    assert b"<html" in page[:2000].lower() and len(page) > 100_000


def test_the_environment_passes_gymnasiums_check():
    gymnasium = pytest.importorskip("gymnasium")
    from gymnasium.utils.env_checker import check_env

    env = gymnasium.make("robert/ur5e-track-v0")
    check_env(env.unwrapped, skip_render_check=True)
    first, _ = env.reset(seed=3)
    total, done = 0.0, False
    while not done:
        _, reward, terminated, done, _ = env.step(env.action_space.sample() * 0)
        total += reward
        assert not terminated
    assert total < 0
    again, _ = env.reset(seed=3)
    assert np.array_equal(first, again)


def test_an_episode_begins_where_a_rollout_of_the_clip_does(tmp_path):
    pytest.importorskip("gymnasium")
    from robert_studio.env import TrackEnv

    robot = rs.Robot("pointmass")
    clip = rs.Clip.from_array(robot, np.full((30, 2), 0.5))
    begins = json.loads(clip.text()) | {"start": {"q": [0.2, -0.1]}}
    (tmp_path / "a.clip.json").write_text(json.dumps(begins))
    clip = rs.Clip.load(tmp_path / "a.clip.json")
    assert np.allclose(clip.start(), [0.2, -0.1])
    first, _ = TrackEnv("pointmass", clip).reset()
    assert np.allclose(first[:2], [0.2, -0.1])


@pytest.mark.parametrize("example", EXAMPLES, ids=[e.stem for e in EXAMPLES])
def test_examples_run(example, tmp_path):
    if example.stem in ("compare", "sweep_table"):
        pytest.importorskip("pandas")
    if example.stem == "compare":
        pytest.importorskip("matplotlib")
    if example.stem == "new_robot" and not shutil.which("robert", path=str(Path(sys.executable).parent)):
        pytest.skip("the command robert is not installed")
    assert len(example.read_text().splitlines()) <= 60
    done = subprocess.run([sys.executable, example, tmp_path], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


def test_stubs_name_what_there_is():
    import ast

    from robert_studio import _native

    tree = ast.parse((Path(rs.__file__).parent / "_native.pyi").read_text())
    named = {n.name: n for n in tree.body if isinstance(n, (ast.ClassDef, ast.FunctionDef))}
    there = {n for n in dir(_native) if not n.startswith("_")}
    assert set(named) == there
    for name, node in named.items():
        if isinstance(node, ast.ClassDef) and not name.endswith(("Error", "Input", "Dependency")):
            members = {n.name for n in node.body if isinstance(n, ast.FunctionDef)}
            members |= {n.target.id for n in node.body if isinstance(n, ast.AnnAssign)}
            real = {n for n in dir(getattr(_native, name)) if not n.startswith("_")}
            assert members - {"__init__"} == real, name


def test_what_makes_no_sense_is_refused(take, tmp_path):
    with pytest.raises(ValueError, match="position or torque"):
        take.export("lerobot", tmp_path / "a", action="torques")
    with pytest.raises(ValueError, match="npz"):
        take.export("glb", tmp_path / "a.glb", bodies="isaac")
    with pytest.raises(rs.InvalidInput):
        rs.Clip.new("ur5e", 0)
    clip = rs.Clip.new("ur5e", 10, "wave")
    with pytest.raises(rs.InvalidInput):
        clip.name = "a\nb"
    assert clip.name == "wave"
    with pytest.raises(ValueError, match="wave"):
        rs.evaluate([clip, clip], ["pd"])
    policy = rs.Policy("ur5e", "pd")
    rows, seen = np.zeros((31, 5)), np.zeros((20, 5), dtype=bool)
    goals = np.full((20, 5), np.nan)
    assert np.isfinite(policy.act(rows, goals, seen)).all()
    seen[3, 1] = True
    with pytest.raises(ValueError, match="goals"):
        policy.act(rows, goals, seen)
    rows[4, 2] = np.nan
    with pytest.raises(ValueError, match="history"):
        policy.act(rows, np.zeros((20, 5)), seen)
