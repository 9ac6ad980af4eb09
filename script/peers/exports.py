#!/usr/bin/env python3
"""Reads exports with the public readers of their formats and compares them with the take.

Body poses of the take come from its own /tf messages through the mcap packages. Libraries
that are missing are named and their checks left out; see README.md for all of them.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
TOLERANCE = 1e-5  # m
LEROBOT = os.environ.get("LEROBOT_PYTHON", sys.executable)
failed = []


def report(name, passed, figure):
    print(f"{'ok  ' if passed else 'FAIL'} {name:34} {figure}")
    if not passed:
        failed.append(name)


def needs(*modules):
    """Whether the libraries are there; the check is left out aloud otherwise."""
    for module in modules:
        try:
            __import__(module)
        except ImportError:
            print(f"left out, no {module}")
            return False
    return True


class Take:
    """A take of a shipped clip: joint values (T, S) and body positions (T, B, 3)."""

    def __init__(self, robert, clip, folder):
        self.robert, self.folder = robert, folder
        self.path = folder / f"{clip.replace('/', '_')}.mcap"
        self.run("rollout", clip, "-p", "pd", "--out", self.path, "-q")
        text = self.run("export", self.path, "--to", "json")
        document = json.loads(text)
        self.joints = document["robot"]["joints"]
        self.bodies = document["robot"]["bodies"]
        self.q = np.array([row["position"] for row in document["achieved"]])
        self.qd = np.array([row["velocity"] for row in document["achieved"]])
        self.ctrl = np.array([row["ctrl"] for row in document["achieved"] if "ctrl" in row])
        self.places = self.transforms()

    def run(self, *args):
        done = subprocess.run([self.robert, *map(str, args)], check=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        return done.stdout.decode()

    def export(self, to, name, *args):
        out = self.folder / name
        printed = json.loads(self.run("export", self.path, "--to", to, "-o", out, "--json", "-q", *args))
        assert all(Path(f).is_file() for f in printed["files"]) and printed["frames"] > 0, printed
        return out

    def transforms(self):
        """World positions of the bodies by the mcap packages; (T, B, 3)."""
        from mcap.reader import make_reader
        from mcap_protobuf.decoder import DecoderFactory

        rows = []
        with open(self.path, "rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            for _, _, _, message in reader.iter_decoded_messages(topics=["/tf"]):
                at = {t.child_frame_id: t.translation for t in message.transforms}
                rows.append([[at[b].x, at[b].y, at[b].z] for b in self.bodies])
        return np.array(rows)


def bvh(take, name):
    """Positions by the bvh package's reading and our own multiplication of its channels."""
    from bvh import Bvh

    file = Bvh(take.export("bvh", f"{name}.bvh").read_text())
    def turn(axis, degrees):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        rows = {"X": [[1, 0, 0], [0, c, -s], [0, s, c]], "Y": [[c, 0, s], [0, 1, 0], [-s, 0, c]], "Z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}
        return np.array(rows[axis])
    worst = 0.0
    for frame in range(0, file.nframes, 7):
        world = {}
        for joint in file.get_joints_names():
            place, rotation = np.zeros(3), np.eye(3)
            for channel in file.joint_channels(joint):
                value = file.frame_joint_channel(frame, joint, channel)
                if channel.endswith("position"):
                    place["XYZ".index(channel[0])] += value
                else:
                    rotation = rotation @ turn(channel[0], value)
            parent = file.joint_parent(joint)
            at, around = world[parent.name] if parent and parent.name in world else (np.zeros(3), np.eye(3))
            world[joint] = (at + around @ (np.array(file.joint_offset(joint)) + place), around @ rotation)
        for body, want in zip(take.bodies, take.places[frame]):
            x, y, z = world[body][0] / 100
            worst = max(worst, np.abs(np.array([x, -z, y]) - want).max())
    report(f"bvh {name}", worst < TOLERANCE and abs(file.frame_time - 0.05) < 1e-9, f"{worst:.1e} m, {file.nframes} frames")


def usd(take, name):
    from pxr import Usd, UsdGeom, UsdValidation

    path = take.export("usda", f"{name}.usda")
    stage = Usd.Stage.Open(str(path))
    prims = {p.GetName(): p for p in stage.Traverse() if p.IsA(UsdGeom.Xform)}
    worst = 0.0
    for frame in range(0, len(take.q), 9):
        cache = UsdGeom.XformCache(frame)
        for body, want in zip(take.bodies, take.places[frame]):
            at = cache.GetLocalToWorldTransform(prims[body]).ExtractTranslation()
            worst = max(worst, np.abs(np.array(at) - want).max())
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    faults = [e.GetMessage() for e in UsdValidation.ValidationContext(validators).Validate(stage)]
    rate = stage.GetTimeCodesPerSecond()
    report(f"usda {name}", worst < TOLERANCE and rate == 20 and not faults, f"{worst:.1e} m, {len(faults)} faults of {len(validators)} validators {faults[:2]}")


def lafan(take, name):
    rows = np.loadtxt(take.export("lafan", f"{name}.lafan.csv"), delimiter=",")
    off = np.abs(rows[:, 7:] - take.q).max()
    report(f"lafan {name}", rows.shape == (len(take.q), 7 + len(take.joints)) and off < 1e-12, f"{off:.1e} rad, {rows.shape}")


def lafan_by_mujoco(take, name):
    """Body positions by MuJoCo's own Python package: the model with its keys, and the rows as joint values."""
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(take.export("mjcf", f"{name}.xml", "--with-model")))
    data = mujoco.MjData(model)
    rows = np.loadtxt(take.export("lafan", f"{name}.fk.csv"), delimiter=",")
    at = [model.joint(joint).qposadr[0] for joint in take.joints]
    # Joints that are no part of the state follow; the key has them all.
    worst = 0.0
    for frame in range(0, len(rows), 7):
        data.qpos[:] = model.key_qpos[frame]
        key = np.abs(data.qpos[at] - rows[frame, 7:]).max()
        data.qpos[at] = rows[frame, 7:]
        mujoco.mj_kinematics(model, data)
        places = [data.body(body).xpos for body in take.bodies]
        worst = max(worst, key, np.abs(np.array(places) - take.places[frame]).max())
    report(f"lafan by mujoco {name}", worst < TOLERANCE, f"{worst:.1e} m, {mujoco.__version__}")


def npz(take, name):
    """Against numpy alone: every fifth row is every second frame of the take."""
    data = np.load(take.export("npz", f"{name}.npz"))
    pos = data["body_pos_w"]
    worst = np.abs(pos[::5] - take.places[::2][: len(pos[::5])]).max()
    steps = np.gradient(pos.astype(float), 0.02, axis=0)
    drift = np.abs(steps - data["body_lin_vel_w"]).max()
    kinds = {k: str(v.dtype) for k, v in data.items()}
    good = worst < TOLERANCE and drift < 1e-3 and data["fps"].tolist() == [50] and set(kinds.values()) == {"int64", "float32"}
    report(f"npz {name}", good, f"{worst:.1e} m, velocity {drift:.1e} m/s of numpy.gradient, {pos.shape}")


def lerobot(take, name, version):
    import datasets

    root = take.export("lerobot", f"{name}_{version}", "--lerobot-version", version)
    printed = subprocess.run([Path(sys.executable).parent / "lerobot-doctor", "check", root, "--json"], stdout=subprocess.PIPE).stdout.decode()
    summary = json.loads(printed[printed.index("{"):])["summary"]
    fails, warns, passes = (summary[word] for word in ("FAIL", "WARN", "PASS"))
    report(f"lerobot-doctor {name} {version}", fails == 0 and passes > 0, f"{passes} PASS, {warns} WARN, {fails} FAIL")
    if fails or not passes:
        print(printed)
    info = json.loads((root / "meta/info.json").read_text())
    kinds = {"float32": datasets.Value("float32"), "int64": datasets.Value("int64")}
    features = datasets.Features({
        key: kinds[f["dtype"]] if f["shape"] == [1] else datasets.List(kinds[f["dtype"]], length=f["shape"][0])
        for key, f in info["features"].items() if f["dtype"] != "video"
    })
    files = sorted(str(p) for p in (root / "data").rglob("*.parquet"))
    rows = datasets.Dataset.from_parquet(files, features=features, cache_dir=str(take.folder / f"cache{version}"))
    off = np.abs(np.array(rows["observation.state"]) - take.q).max()
    if version == "3.0":
        import pandas
        tasks = pandas.read_parquet(root / "meta/tasks.parquet")
        task = tasks.iloc[0].name
    else:
        task = json.loads((root / "meta/tasks.jsonl").read_text().splitlines()[0])["task"]
    report(f"datasets {name} {version}", rows.features == features and off < 1e-6 and isinstance(task, str), f"{off:.1e} rad, {len(rows)} rows, task {task!r}")
    # What lerobot-replay does: names zipped with the row go to the robot.
    class Mock:
        def send_action(self, action):
            assert set(action) == {f"{j}.pos" for j in take.joints}
            return action
    names, robot = info["features"]["action"]["names"], Mock()
    sent = [robot.send_action(dict(zip(names, row))) for row in rows["action"]]
    last = np.array([sent[-1][f"{j}.pos"] for j in take.joints])
    report(f"replay {name} {version}", np.abs(last - take.q[-1]).max() < 1e-6, f"{len(sent)} actions")


def lerobot_itself(take, name):
    """lerobot with torch, which may be in another interpreter: LEROBOT_PYTHON."""
    wanted = take.folder / f"{name}.lerobot.json"
    for films in ([], ["--video", "96x72"]):
        root = take.export("lerobot", f"{name}_itself{len(films)}", "--task", "move", *films)
        document = {"joints": take.joints, "q": take.q.tolist(), "task": "move", "frames": len(take.q)}
        wanted.write_text(json.dumps(document))
        done = subprocess.run([LEROBOT, HERE / "lerobot_replay.py", root, wanted], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        printed = done.stdout.decode().strip().splitlines()
        report(f"lerobot itself {name}{' film' if films else ''}", done.returncode == 0, printed[-1] if printed else "nothing was printed")
        if done.returncode:
            print(done.stderr.decode())


def minari(take, name):
    root = take.export("minari", f"{name}_minari")
    os.environ["MINARI_DATASETS_PATH"] = str(root)
    import minari

    dataset = minari.load_dataset(next(iter(minari.list_local_datasets())))
    episode = next(iter(dataset.iterate_episodes()))
    n = len(take.q)
    off = np.abs(episode.observations - np.hstack([take.q, take.qd])).max()
    lengths = episode.observations.shape == (n, 2 * len(take.joints)) and episode.actions.shape == (n - 1, take.ctrl.shape[1])
    good = off < 1e-12 and lengths and episode.truncations[-1] and not episode.terminations.any()
    inside = dataset.observation_space.contains(episode.observations[0])
    report(f"minari {name}", good and inside and dataset.total_steps == n - 1, f"{off:.1e}, {dataset.total_steps} steps, {dataset.spec.dataset_id}")


def bag(take, name):
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    folder = take.export("bag", f"{name}_bag")
    with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        rows = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages() if c.topic == "/joint_states"]
        path = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages() if c.topic.endswith("joint_trajectory")]
    off = np.abs(np.array([r.position for r in rows]) - take.q).max()
    last = path[0].points[-1]
    report(f"bag {name}", off == 0 and len(path) == 1 and not last.velocities.any(), f"{off:.1e} rad, {len(rows)} states, {len(path[0].points)} points")


def glb(take, name):
    path = take.export("glb", f"{name}.glb")
    wanted = {"bodies": take.bodies, "fps": 20, "places": {f: take.places[f].tolist() for f in range(0, len(take.q), max(1, len(take.q) // 10))}}
    poses = take.folder / f"{name}.poses.json"
    poses.write_text(json.dumps(wanted))
    done = subprocess.run(["node", HERE / "glb.cjs", path, poses], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    lines = done.stdout.decode().strip().splitlines()
    report(f"glb {name}", done.returncode == 0, lines[-1] if lines else "no output")
    if done.returncode:
        print("\n".join(lines[:-1]))


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--robert", default="robert", help="the binary")
    arguments.add_argument("--clips", nargs="+", default=["ur5e/reacher", "shadow_hand/rsp", "pointmass/circle"])
    args = arguments.parse_args()
    if not needs("mcap", "mcap_protobuf"):
        sys.exit("these two are needed for all checks: pip install mcap mcap-protobuf-support")
    checks = [
        (bvh, ["bvh"]), (usd, ["pxr"]), (lafan, []), (lafan_by_mujoco, ["mujoco"]), (npz, []), (minari, ["minari"]), (bag, ["rosbags"]), (glb, []),
        (lambda t, n: lerobot(t, n, "3.0"), ["datasets", "lerobot_doctor"]),
        (lambda t, n: lerobot(t, n, "2.1"), ["datasets", "lerobot_doctor"]),
    ]
    checks = [check for check, modules in checks if needs(*modules)]
    if subprocess.run([LEROBOT, "-c", "import lerobot.datasets"], stderr=subprocess.DEVNULL).returncode:
        print("left out, no lerobot")
    else:
        checks.append(lerobot_itself)
    robert = str(Path(args.robert).resolve()) if "/" in args.robert else args.robert
    with tempfile.TemporaryDirectory() as folder:
        for clip in args.clips:
            take = Take(robert, clip, Path(folder))
            for check in checks:
                check(take, clip.split("/")[0])
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
