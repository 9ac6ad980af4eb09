"""Compare policies with pandas and draw the errors: python compare.py [FOLDER]"""

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import pandas as pd

import robert_studio as rs

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
folder.mkdir(exist_ok=True)

clips = rs.Clip.suite("ur5e", "manual")
policies = ["pd", "ridge", "robert", "computed-torque"]
rows = pd.DataFrame(rs.evaluate(clips, policies, floors=False))
table = rows.pivot(index="task", columns="policy", values="precision")
table.loc["mean"] = table.mean()
print(table.to_string(float_format="{:.5f}".format))
table.to_csv(folder / "compare.csv")

figure, axes = plt.subplots(figsize=(8, 3))
name, clip = next(iter(clips.items()))
for policy in policies:
    take = rs.rollout(clip, policy)
    axes.plot(take.times, take.error.mean(axis=1), label=policy)
axes.set(xlabel="time, s", ylabel="mean |error|, rad", yscale="log", title=name)
axes.legend()
figure.tight_layout()
figure.savefig(folder / "compare.png")
