"""This renderer against MuJoCo's own off-screen renderer (EGL), in turns.

    python benches/peers/render.py --robert target/release/robert [--turns 3] [--frames 20]

Needs `pip install mujoco` and EGL (libegl1, libgl1-mesa-dri). Same model, poses, camera, picture
size, 4 samples and 2048 shadow; processor time of the whole process a frame, after warm-up. The
pictures are not the same: MuJoCo adds a skybox and two lights, this one an endless floor. The
second model is six meshes of 8192 faces each on six hinges, written to a temporary folder.
"""

import argparse
import json
import math
import os
import pathlib
import resource
import statistics
import struct
import subprocess
import sys
import tempfile

os.environ.setdefault("MUJOCO_GL", "egl")

ROOT = pathlib.Path(__file__).resolve().parents[2]


def blob(path, columns=64, rows=65):
    """A dented ball as binary STL: 2 * columns * (rows - 1) = 8192 faces."""
    def at(i, j):
        a, b = 2 * math.pi * i / columns, math.pi * j / rows
        r = 0.11 * (1 + 0.06 * math.sin(5 * a) * math.sin(4 * b))
        return (r * math.sin(b) * math.cos(a), r * math.sin(b) * math.sin(a), 1.4 * r * math.cos(b))

    faces = []
    for i in range(columns):
        for j in range(rows):
            p, q, r, s = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
            if j > 0:
                faces.append((p, r, q))
            if j < rows - 1:
                faces.append((p, s, r))
    with open(path, "wb") as out:
        out.write(b"\0" * 80 + struct.pack("<I", len(faces)))
        for f in faces:
            out.write(struct.pack("<12fH", *([0.0] * 3), *f[0], *f[1], *f[2], 0))
    return len(faces)


STAGE = """<asset><texture type="skybox" builtin="gradient" rgb1="0.7 0.75 0.8" rgb2="0.4 0.45 0.5"
width="256" height="1536"/><texture name="peer_checker" type="2d" builtin="checker" rgb1="0.5 0.5 0.55"
rgb2="0.45 0.45 0.5" width="512" height="512"/><material name="peer_floor" texture="peer_checker"
texrepeat="8 8" texuniform="true"/></asset>"""
SUN = """<worldbody><light directional="true" castshadow="true" pos="0 -1 3" dir="0.2 0.5 -1"
diffuse="0.7 0.7 0.7"/></worldbody>"""


def staged(xml):
    """The model with what this renderer draws by itself: sun with shadow, checker floor, sky."""
    text = pathlib.Path(xml).read_text()
    text = text.replace("</mujoco>", STAGE + ("" if "<light" in text else SUN) + "</mujoco>")
    out = pathlib.Path(xml).with_name("staged.xml")
    if out.parent.is_relative_to(ROOT):
        out = pathlib.Path(tempfile.mkdtemp()) / "staged.xml"
    out.write_text(text.replace('name="floor"', 'name="floor" material="peer_floor"', 1))
    return str(out)


def arm(folder):
    """Writes robot.xml with six meshes; says how many faces it has."""
    faces = sum(blob(folder / f"link{k}.stl") for k in range(6))
    body = ""
    for k in range(6):
        axis = ("0 0 1", "0 1 0")[k % 2]
        body += (f'<body name="link{k}" pos="0 0 {0.16 if k else 0.2}">'
                 f'<joint name="j{k}" axis="{axis}" range="-2 2" limited="true" damping="1"/>'
                 f'<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>'
                 f'<geom type="mesh" mesh="link{k}" contype="0" conaffinity="0" group="1" '
                 f'rgba="{0.3 + 0.1 * k} 0.5 {0.8 - 0.1 * k} 1"/>')
    body += "</body>" * 6
    meshes = "".join(f'<mesh name="link{k}" file="link{k}.stl"/>' for k in range(6))
    motors = "".join(f'<motor name="m{k}" joint="j{k}" ctrlrange="-1 1" ctrllimited="true"/>' for k in range(6))
    (folder / "robot.xml").write_text(
        f'<mujoco model="arm"><compiler angle="radian"/><option timestep="0.005"/><asset>{meshes}</asset>'
        f'<worldbody><geom name="floor" type="plane" size="0 0 1" contype="0" conaffinity="0"/>{body}'
        f'</worldbody><actuator>{motors}</actuator></mujoco>')
    return faces


def cpu():
    r = resource.getrusage(resource.RUSAGE_SELF)
    return r.ru_utime + r.ru_stime


def peer(args):
    """Runs in a process of its own: prints processor milliseconds a frame."""
    import mujoco
    import numpy as np
    spec = json.loads(args.peer)
    model = mujoco.MjModel.from_xml_path(staged(spec["model"]))
    model.vis.quality.offsamples = 4
    model.vis.quality.shadowsize = 2048
    model.vis.global_.offwidth, model.vis.global_.offheight = spec["width"], spec["height"]
    model.vis.global_.fovy = spec["fov_y_deg"]
    data = mujoco.MjData(model)
    view = np.array(spec["target"]) - np.array(spec["eye"])
    camera = mujoco.MjvCamera()
    camera.lookat[:] = spec["target"]
    camera.distance = float(np.linalg.norm(view))
    camera.azimuth = math.degrees(math.atan2(view[1], view[0]))
    camera.elevation = math.degrees(math.asin(view[2] / camera.distance))
    home = np.array(spec["home"])
    count = 0
    with mujoco.Renderer(model, spec["height"], spec["width"]) as renderer:
        def frame(i):
            data.qpos[:] = home + 0.15 * np.sin(0.2 * i + np.arange(model.nq))
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            renderer.update_scene(data, camera)
            picture = renderer.render()
            return picture, renderer.scene.ngeom
        for i in range(3):
            picture, count = frame(i)
        start = cpu()
        for i in range(args.frames):
            picture, count = frame(3 + i)
        spent = 1e3 * (cpu() - start) / args.frames
    if args.save:
        import zlib
        rows = b"".join(b"\0" + r.tobytes() for r in picture)
        def chunk(kind, body):
            return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        pathlib.Path(args.save).write_bytes(
            b"\x89PNG\r\n\x1a\n"
            + chunk(b"IHDR", struct.pack(">2I5B", spec["width"], spec["height"], 8, 2, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
    print(json.dumps({"ms": spent, "geoms": count, "version": mujoco.__version__}))


def ours(args, robot):
    command = [args.robert, "bench", "render", "--json", "--robot", robot, "--frames", str(args.frames)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--robert", default=str(ROOT / "target/release/robert"))
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--peer", help=argparse.SUPPRESS)
    parser.add_argument("--save", help="keep the peer's last picture here")
    args = parser.parse_args()
    if args.peer:
        return peer(args)
    with tempfile.TemporaryDirectory() as temp:
        temp = pathlib.Path(temp)
        print(f"arm: {arm(temp)} faces")
        for name, robot, xml in (("hand", "shadow_hand", ROOT / "assets/robots/shadow_hand/robot.xml"),
                                 ("arm", str(temp), temp / "robot.xml")):
            here, there = [], []
            for _ in range(args.turns):
                mine = ours(args, robot)
                here.append(mine["cpu_ms_per_frame"])
                nq = 22 if name == "hand" else 6
                spec = {"model": str(xml), "home": [0.0] * nq} | {
                    k: mine[k] for k in ("width", "height", "eye", "target", "fov_y_deg")}
                command = [sys.executable, __file__, "--peer", json.dumps(spec), "--frames", str(args.frames)]
                command += ["--save", args.save] if args.save else []
                run = subprocess.run(command, check=True, capture_output=True, text=True)
                other = json.loads(run.stdout.splitlines()[-1])
                there.append(other["ms"])
            ratio = statistics.median(t / h for t, h in zip(there, here))
            print(f"{name}: ours {statistics.median(here):.1f} ms, MuJoCo {other['version']} "
                  f"{statistics.median(there):.1f} ms processor time a frame, ratio {ratio:.2f} "
                  f"(turns: {', '.join(f'{t / h:.2f}' for t, h in zip(there, here))}); "
                  f"{mine['width']}x{mine['height']}, {mine['samples']} samples, shadow {mine['shadow_px']}, "
                  f"geoms {mine['geoms']} / {other['geoms']}")


if __name__ == "__main__":
    main()
