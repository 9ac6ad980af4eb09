"""Policy.act and rollout from Python beside the same work in Rust, built alike.

    script/python                                             builds the package in the dev profile
    cargo build --example policy_speed                        and the same work in Rust
    target/python/bin/python python/tests/speed.py            five rounds of each in turn

Prints the least and the median time of both and their ratios; exit code 1 when a ratio of the least times is above
1.2 (act) or 1.05 (rollout). The least times count, because other work on the machine only ever adds.
"""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import robert_studio as rs

RUST = Path(__file__).resolve().parents[2] / "target/debug/examples/policy_speed"
BOUNDS = {"act_secs": 1.2, "rollout_secs": 1.05}


def times(work, runs):
    found = []
    for _ in range(runs):
        begin = time.perf_counter()
        work()
        found.append(time.perf_counter() - begin)
    return found


def main(rust=str(RUST), rounds="5"):
    robot = rs.Robot("ur5e")
    policy = rs.Policy(robot, "robert")
    past = np.tile(robot.home(), (31, 1))
    goals, mask = np.tile(robot.home(), (20, 1)), np.ones((20, len(robot.joints)), bool)
    clip = rs.Clip.task("ur5e/reacher")
    times(lambda: policy.act(past, goals, mask), 50)
    own = {"act_secs": [], "rollout_secs": []}
    other = {name: [] for name in own}
    for _ in range(int(rounds)):
        own["act_secs"] += times(lambda: policy.act(past, goals, mask), 1000)
        own["rollout_secs"] += times(lambda: rs.rollout(clip, "robert"), 7)
        report = json.loads(subprocess.run([rust], capture_output=True, check=True).stdout)
        for name in other:
            other[name].append(report[name])
    good = True
    for name, bound in BOUNDS.items():
        least, median = min(own[name]), float(np.median(own[name]))
        rust_least = min(r["least"] for r in other[name])
        rust_median = float(np.median([r["median"] for r in other[name]]))
        good &= least <= bound * rust_least
        print(
            f"{name:13} Python {1e3 * least:.4f} ms least, {1e3 * median:.4f} ms median; "
            f"Rust {1e3 * rust_least:.4f} and {1e3 * rust_median:.4f}; "
            f"ratios {least / rust_least:.3f} and {median / rust_median:.3f}, at most {bound}"
        )
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
