"""Policy.act and rollout from Python beside the same work in Rust, built alike.

    script/python                                             builds the package in the dev profile
    cargo build --example policy_speed                        and the same work in Rust
    target/python/bin/python python/tests/speed.py            five rounds of each in turn

Another program may be named, such as target/release/examples/policy_speed for a wheel of the release profile.
Prints the least and the median seconds of both, by the wall and of the processor, and their ratios; exit code 1
when a ratio of the medians of processor time is above 1.2 (act) or 1.05 (rollout). Processor time counts, because
a busy machine lets the one wait longer than the other.
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
CLOCKS = {"wall": time.perf_counter, "processor": time.process_time}


def times(work, runs):
    found = {clock: [] for clock in CLOCKS}
    for _ in range(runs):
        begin = {name: clock() for name, clock in CLOCKS.items()}
        work()
        for name, clock in CLOCKS.items():
            found[name].append(clock() - begin[name])
    return {name: {"least": min(of), "median": float(np.median(of))} for name, of in found.items()}


def main(rust=str(RUST), rounds="5"):
    robot = rs.Robot("ur5e")
    policy = rs.Policy(robot, "robert")
    past = np.tile(robot.home(), (31, 1))
    goals, mask = np.tile(robot.home(), (20, 1)), np.ones((20, len(robot.joints)), bool)
    clip = rs.Clip.task("ur5e/reacher")
    times(lambda: policy.act(past, goals, mask), 50)
    pairs = []
    for _ in range(int(rounds)):
        own = {
            "act_secs": times(lambda: policy.act(past, goals, mask), 1000),
            "rollout_secs": times(lambda: rs.rollout(clip, "robert"), 7),
        }
        pairs.append((own, json.loads(subprocess.run([rust], capture_output=True, check=True).stdout)))
    good = True
    for name, bound in BOUNDS.items():
        for clock in CLOCKS:
            # Of each round the ratio, so that what slows the machine down slows both.
            ratio = {of: float(np.median([a[name][clock][of] / b[name][clock][of] for a, b in pairs])) for of in ("least", "median")}
            ours, theirs = (1e3 * float(np.median([pair[i][name][clock]["median"] for pair in pairs])) for i in (0, 1))
            print(f"{name:13} {clock:9} Python {ours:.4f} ms, Rust {theirs:.4f} ms; ratio of medians {ratio['median']:.3f}, of the least {ratio['least']:.3f}")
            good &= clock == "wall" or ratio["median"] <= bound
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
