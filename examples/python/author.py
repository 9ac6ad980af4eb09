"""Author a clip in code, roll it out, look at it: python author.py [FOLDER]"""

import sys
from pathlib import Path

import numpy as np

import robert_studio as rs

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
folder.mkdir(exist_ok=True)

# Four seconds of the arm: home, a raised pose held for half a second, home; the rest is the policy's.
clip = rs.Clip.new("ur5e", frames=81, name="raise")
home = clip.robot.home()
raised = home + np.array([0.4, 0.3, -0.5, 0.2, 0.0])
clip.key(0, home).key(40, raised, hold=10).key(80, home)
clip.save(folder / "raise.clip.json")

take = rs.rollout(clip)
print(clip)
print(take, f"Precision {take.precision['precision']:.5f} rad")
print("largest error, degrees:", np.degrees(np.nanmax(take.error)).round(3))
take.save(folder / "raise.mcap")
made = take.export("glb", folder / "raise.glb")
print(made["files"][0], *made["meaning"], sep="\n  ")
