"""From the results of "acromion run" to the table, figure and methods of a paper: python paper.py OUT."""

import sys
from pathlib import Path

import pandas as pd

from acromion import Study, describe_group, find_designs, list_days

FIGURES = {
    "time_above_30_percent": "Time above 30°, %",
    "time_above_60_percent": "Time above 60°, %",
    "time_above_90_percent": "Time above 90°, %",
    "elevation_p50_deg": "Median elevation, °",
}


def show(value, spread=None):
    """Return a value with its 95 % range; a dash if it is unknown."""
    if value is None:
        return "–"
    return f"{value:.1f}" + (f" ({spread.low:.1f} to {spread.high:.1f})" if spread else "")


def summarise(days):
    """Return the rows of the table: each figure by job, with people and days, mean and both deviations."""
    for job, rows in days.groupby("job_title"):
        for figure, label in FIGURES.items():
            group = describe_group(list_days(rows, figure))
            yield {
                "job": job,
                "figure": label,
                "people": group.people,
                "days": group.days,
                "mean": show(group.mean, group.mean_range),
                "sd_between": show(group.between_sd, group.between_range),
                "sd_within": show(group.within_sd, group.within_range),
            }


study = Study.read(sys.argv[1])
print(study)
counted = study.days[study.days["left_out"].isna()].fillna({"job_title": "not stated"})
right = counted.query("side == 'right' and verdict != 'poor'")
if right.empty:
    sys.exit("No day of a right arm counts: see left_out and verdict in days.csv, and problems.csv.")
table = pd.DataFrame(summarise(right))
table.to_csv("table.csv", index=False)
print(table.to_string(index=False))

study.plot_people("time_above_60_percent", right).savefig("figure.png", dpi=200)

group = describe_group(list_days(right, "time_above_60_percent"))
if group.within_sd is not None and group.between_sd is not None:
    for design in find_designs(group.within_sd, group.between_sd, margin=2.0):
        print(f"mean within 2 points: {design.people} people on {design.days} days each")

Path("methods.md").write_text(study.methods, "utf-8")
