#!/usr/bin/env python3
"""Imports foreign robots from published packages and compares them with MuJoCo's own load.

    tests/peers/import.py [--robert BINARY] [--work DIR]

Not part of the test suite: it downloads about 320 MB with pip. Each model is imported,
stepped for five seconds at zero control, and compared in nq, body masses, centres of mass
and forward kinematics at eight drawn poses with what libmujoco itself makes of the source
(a C program beside this file). Prints a table; exits 1 when any figure is off by more than
1e-9 or fewer than six models agree.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
import time
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
TOLERANCE = 1e-9
ROBOSUITE = "robosuite/models/assets/robots"
GYM = "gymnasium_robotics/envs/assets"
HAND = "robopianist/models/hands/third_party/shadow_hand"
DATA = "cmeel.prefix/share/example-robot-data"

PACKAGES = {
    "robopianist==1.0.10": HAND,
    "gymnasium-robotics==1.4.2": GYM,
    "robosuite==1.5.2": ROBOSUITE,
    "example-robot-data==6.0.0": DATA,
}

# Name, source, further arguments of `robert import`.
MODELS = [
    ("shadow right (robopianist)", f"{HAND}/right_hand.xml", []),
    ("shadow left (robopianist)", f"{HAND}/left_hand.xml", []),
    ("shadow (gymnasium-robotics)", f"{GYM}/hand/reach.xml", ["--root", GYM]),
    ("adroit pen (gymnasium-robotics)", f"{GYM}/adroit_hand/adroit_pen.xml", ["--root", GYM]),
    ("ur5e (robosuite)", f"{ROBOSUITE}/ur5e/robot.xml", []),
    ("panda (robosuite)", f"{ROBOSUITE}/panda/robot.xml", []),
    ("kinova3 (robosuite)", f"{ROBOSUITE}/kinova3/robot.xml", []),
    ("iiwa (robosuite)", f"{ROBOSUITE}/iiwa/robot.xml", []),
    ("jaco (robosuite)", f"{ROBOSUITE}/jaco/robot.xml", []),
    ("ur3 urdf", f"{DATA}/robots/ur_description/urdf/ur3_robot.urdf", []),
    ("ur5 urdf", f"{DATA}/robots/ur_description/urdf/ur5_robot.urdf", []),
    ("panda urdf", f"{DATA}/robots/panda_description/urdf/panda.urdf", []),
    ("allegro urdf", f"{DATA}/robots/allegro_hand_description/urdf/allegro_right_hand.urdf", []),
    ("double pendulum urdf", f"{DATA}/robots/double_pendulum_description/urdf/double_pendulum.urdf", []),
    ("g1 29 joints urdf", f"{DATA}/robots/g1_description/urdf/g1_29dof_rev_1_0.urdf", []),
    ("solo12 urdf", f"{DATA}/robots/solo_description/robots/solo12.urdf", []),
]


def run(*command, **more):
    return subprocess.run([str(c) for c in command], capture_output=True, text=True, **more)


def fetch(work):
    wheels, root = work / "wheels", work / "unpacked"
    wheels.mkdir(parents=True, exist_ok=True)
    for package, part in PACKAGES.items():
        if (root / part).is_dir():
            continue
        stem = package.split("==")[0].replace("-", "_")
        if not list(wheels.glob(f"{stem}-*.whl")):
            got = run(sys.executable, "-m", "pip", "download", "--no-deps", "-d", wheels, package)
            if got.returncode:
                sys.exit(f"pip download {package}: {got.stderr.strip()[-400:]}")
        with zipfile.ZipFile(next(wheels.glob(f"{stem}-*.whl"))) as z:
            z.extractall(root, [n for n in z.namelist() if n.startswith(part)])
    return root


def plain_source(source, root, work):
    """A copy that libmujoco can read by itself: paths without packages, links kept apart."""
    if source.suffix != ".urdf":
        return source
    text = source.read_text()
    text = text.replace("package://example-robot-data/", f"{root / DATA}/")
    settings = '<mujoco><compiler fusestatic="false" strippath="false" balanceinertia="true"/></mujoco>'
    text, n = re.subn(r"(<robot\b[^>]*>)", lambda m: m.group(1) + settings, text, count=1)
    assert n == 1
    copy = work / "plain.urdf"
    copy.write_text(text)
    return copy


def numbers(words):
    return [float(w) for w in words]


def compare(ours, source, comparer):
    rows = "\n".join(" ".join(repr(v) for v in p["qpos"]) for p in ours["poses"])
    head = f'{len(ours["joints"])} {len(ours["poses"])}\n' + "\n".join(ours["joints"])
    got = run(comparer, source, input=f"{head}\n{rows}\n")
    if got.returncode:
        return None, got.stderr.strip().replace("\n", " ")[:90]
    nq, mass, com, poses = None, {}, {}, {}
    for line in got.stdout.splitlines():
        kind, *words = line.split()
        if kind == "nq":
            nq = int(words[0])
        elif kind == "body":
            mass[int(words[0])], com[int(words[0])] = float(words[1]), numbers(words[2:])
        else:
            poses[int(words[0]), int(words[1])] = numbers(words[2:])
    worst = {"mass": 0.0, "com": 0.0, "pos": 0.0, "quat": 0.0}
    seen = 0
    for n, b in enumerate(ours["bodies"], 1):
        if n in mass:
            seen += 1
            worst["mass"] = max(worst["mass"], abs(b["mass"] - mass[n]))
            worst["com"] = max([worst["com"]] + [abs(x - y) for x, y in zip(b["ipos"], com[n])])
    for k, p in enumerate(ours["poses"]):
        for n, frame in enumerate(p["bodies"], 1):
            if (k, n) not in poses:
                continue
            x = poses[k, n]
            worst["pos"] = max([worst["pos"]] + [abs(a - b) for a, b in zip(frame["xpos"], x)])
            sign = 1 if sum(a * b for a, b in zip(frame["xquat"], x[3:])) > 0 else -1
            worst["quat"] = max([worst["quat"]] + [abs(a - sign * b) for a, b in zip(frame["xquat"], x[3:])])
    worst["total"] = abs(ours["mass"] - sum(mass.values()))
    return {"nq": nq, "bodies": len(mass), "seen": seen, **worst}, ""


def main():
    args = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    args.add_argument("--robert", default=HERE.parents[1] / "target/release/robert", type=Path)
    args.add_argument("--work", default=HERE.parents[1] / "target/peers", type=Path)
    args = args.parse_args()
    args.work.mkdir(parents=True, exist_ok=True)
    root = fetch(args.work)
    comparer = args.work / "kinematics"
    subprocess.run(["cc", "-O2", "-o", comparer, HERE / "kinematics.c", "-lmujoco", "-lm"], check=True)
    out = args.work / "imported"
    shutil.rmtree(out, ignore_errors=True)
    good = bad = 0
    print("| model | nq own / ours | bodies own / matched | files | mass | centre | position | quaternion | 5 s | import s |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for n, (name, source, more) in enumerate(MODELS):
        more = [root / m if m == GYM else m for m in more] + ["--package", f"example-robot-data={root / DATA}"]
        folder = out / str(n)
        start = time.monotonic()
        report = run(args.robert, "-q", "import", root / source, "--out", folder, "--json", *more)
        took = time.monotonic() - start
        if report.returncode:
            bad += 1
            print(f"| {name} | refused: {report.stderr.strip()[:200]} |")
            continue
        report = json.loads(report.stdout)
        ours = run(args.robert, "-q", "robots", "kinematics", folder, "--poses", 8, "--secs", 5)
        if ours.returncode:
            bad += 1
            print(f"| {name} | broken: {ours.stderr.strip()[:200]} |")
            continue
        ours = json.loads(ours.stdout)
        own, why = compare(ours, plain_source(root / source, root, args.work), comparer)
        if own is None:
            bad += 1
            print(f"| {name} | MuJoCo itself refuses the source: {why} |")
            continue
        agrees = own["nq"] == ours["nq"] and own["seen"] == own["bodies"] == len(ours["bodies"]) and ours["step_error"] is None
        agrees &= all(own[k] <= TOLERANCE for k in ("mass", "com", "pos", "quat", "total"))
        good, bad = (good + 1, bad) if agrees else (good, bad + 1)
        figures = " | ".join(f"{own[k]:.1e}" for k in ("mass", "com", "pos", "quat"))
        stepped = "ok" if ours["step_error"] is None else ours["step_error"]
        print(f"| {name} | {own['nq']} / {ours['nq']} | {own['bodies']} / {own['seen']} | {report['files']} | {figures} | {stepped} | {took:.1f} |")
    print(f"\n{good} agree to {TOLERANCE:g}, {bad} do not")
    sys.exit(bad > 0 or good < 6)


if __name__ == "__main__":
    main()
