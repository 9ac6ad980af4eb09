"""A LeRobot dataset of 20 takes, each another motion: python lerobot_dataset.py [FOLDER]"""

import json
import sys
from pathlib import Path

import numpy as np

import robert_studio as rs

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
robot = rs.Robot("ur5e")
home, (low, high) = robot.home(), robot.ranges.T
draws = np.random.default_rng(7)

takes = []
for episode in range(20):
    reach = np.clip(home + draws.uniform(-0.4, 0.4, len(home)), low, high)
    clip = rs.Clip.new(robot, frames=61, name="reach and return")
    clip.key(0, home).key(30, reach, hold=6).key(60, home).fill("cubic")
    takes.append(rs.rollout(clip, "computed-torque", seed=episode))

rename = {joint: joint.removesuffix("_joint") for joint in robot.joints}
made = rs.export(takes, "lerobot", folder / "reach", degrees=True, rename=rename)
info = json.loads((folder / "reach/meta/info.json").read_text())
print(info["total_episodes"], "episodes,", info["total_frames"], "frames,", info["features"]["action"]["names"])
print(*made["meaning"], made["open"], sep="\n")
