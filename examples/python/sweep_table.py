"""A sweep's table: how policies bear a robot that is not the one of its file."""

import pandas as pd

import robert_studio as rs

clips = {"reacher": rs.Clip.task("ur5e/reacher")}
rows = []
for factor in [0.5, 0.75, 1.0, 1.5, 2.0]:
    for row in rs.evaluate(clips, ["pd", "ridge", "robert", "computed-torque"], plant=f"damping={factor}", floors=False):
        rows.append({"damping": factor, "policy": row["policy"], "precision": row["precision"]})

table = pd.DataFrame(rows).pivot(index="damping", columns="policy", values="precision")
print("Precision on ur5e/reacher, rad, by the factor of the damping")
print(table.to_string(float_format="{:.5f}".format))
