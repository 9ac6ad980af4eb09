"""From a URDF to a motion: python new_robot.py [FOLDER]"""

import sys
import tempfile
from pathlib import Path

import robert_studio as rs

urdf = Path(__file__).resolve().parent.parent / "arm.urdf"
folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp())

report = rs.import_robot(urdf, folder / "my_arm")
print(report["id"], report["state_dim"], "joints;", "assumed:", *report["assumed"][:2])
robot = rs.Robot(folder / "my_arm")

# The arm moves at random behind weak servos, and a closed form learns from it.
data = rs.collect(robot, folder / "data", agents=["babble"], transitions=20_000)
print(len(data), "trajectories,", data.frames, "frames")
fitted = rs.fit("ridge", folder / "data")

home = robot.home()
clip = rs.Clip.new(robot, frames=61, name="nod")
clip.key(0, home).key(30, home + 0.2, hold=5).key(60, home).fill("cubic")
for policy in ["pd", f"ridge:{fitted['out']}"]:
    take = rs.rollout(clip, policy, robot=robot)
    print(f"{take.policy:8} Precision {take.precision['precision']:.5f} rad")
