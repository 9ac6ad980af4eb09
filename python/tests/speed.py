"""Policy.act and rollout from Python beside the program: python speed.py [ROBERT]

The call from Python is timed with the arrays that act takes; `robert bench infer` times the same window in Rust. A
rollout of 200 frames is timed in this process and as the program's own clock reports it."""

import json
import subprocess
import sys
import time

import numpy as np

import robert_studio as rs


def best(work, times):
    found = []
    for _ in range(times):
        begin = time.perf_counter()
        work()
        found.append(time.perf_counter() - begin)
    return min(found), float(np.median(found))


def main():
    program = sys.argv[1] if len(sys.argv) > 1 else "robert"
    robot = rs.Robot("ur5e")
    policy = rs.Policy(robot, "robert")
    past = np.tile(robot.home(), (31, 1))
    goals, mask = np.tile(robot.home(), (20, 1)), np.ones((20, len(robot.joints)), bool)
    for _ in range(50):
        policy.act(past, goals, mask)
    least, median = best(lambda: policy.act(past, goals, mask), 1000)
    print(f"Policy.act  {1e6 * median:.1f} us median, {1e6 * least:.1f} us least")
    clip = rs.Clip.task("ur5e/reacher")
    least, median = best(lambda: rs.rollout(clip, "robert"), 7)
    report = [
        json.loads(subprocess.run([program, "rollout", "ur5e/reacher", "-p", "robert", "--json", "-q"], capture_output=True, check=True).stdout)
        for _ in range(7)
    ]
    own = [r["wall_secs"] for r in report]
    print(f"rollout     {1e3 * median:.1f} ms median, {1e3 * least:.1f} ms least ({clip.frames} frames), take included")
    print(f"program     {1e3 * np.median(own):.1f} ms median, {1e3 * min(own):.1f} ms least, rollout alone")


if __name__ == "__main__":
    main()
