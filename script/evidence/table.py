"""A table of results/tables.toml as Markdown.

A cell's address has the fields file, suite, policy, task and figure. Defaults of the table, the
row and the column each give some of them; `figure` is `precision` where nobody gives one. A
column's `fill` replaces {} in the policy. Jams of several seeds are listed, not averaged.
"""

import re
import statistics

from . import markdown, record
from .record import Missing

# These simulate the robot or use its complete model, so they are not marked as best.
KNOW_THE_MODEL = {"computed-torque", "ilqr", "predictive-sampling", "auto"}
# 97.5 % quantile of Student's t by the number of seeds.
STUDENT = {2: 12.706, 3: 4.303, 4: 3.182, 5: 2.776, 8: 2.365}
FIELDS = ("file", "suite", "policy", "task", "figure")


def render(spec):
    """The table and the files it was made from."""
    return KINDS[spec.get("kind", "cells")](spec)


def cells(spec):
    """Figures of evaluations; the best of each row is bold, or of each column (`bold = "down"`)."""
    rows = list(expand(spec))
    grid = [[address(spec, row, column) for column in spec["columns"]] for row in rows]
    shown = [[entry(at, spec) for at in line] for line in grid]
    if spec.get("bold", "across") == "across":
        shown = [embolden(line) for line in shown]
    elif spec["bold"] == "down":
        shown = transposed([embolden(line) for line in transposed(shown)])
    head = [spec.get("corner", ""), *(column["label"] for column in spec["columns"])]
    lines = [[row["label"], *(text for text, _ in line)] for row, line in zip(rows, shown)]
    return markdown.table(head, lines), [at["file"] for line in grid for at in line]


def transposed(lines):
    return [list(line) for line in zip(*lines)]


def entry(at, spec):
    """A cell's text and the number that it competes with; None where it does not compete."""
    try:
        number = value(at)
    except Missing:
        if not spec.get("gaps"):
            raise
        number = None
    if at["figure"] == "jams" and number is not None and len(counts := over_seeds(at)) > 1:
        return ", ".join(form(count, "jams") for count in counts), None
    base, *options = at["policy"].replace(":", "+").split("+")
    rival = at["figure"] == "precision" and base not in KNOW_THE_MODEL and "refine" not in options
    text = form(number, at["figure"], spec.get("digits", 5))
    if number is not None and (far := spread(at)) is not None:
        return f"{text} ± {form(far, at['figure'], spec.get('digits', 5))}", None
    return text, number if rival else None


def embolden(line):
    """The same cells with the lowest competing number bold, unless all read the same."""
    rivals = [(number, text) for text, number in line if number is not None]
    if len({text for _, text in rivals}) < 2:
        return line
    best = min(rivals)[1]
    return [(f"**{t}**" if n is not None and t == best else t, n) for t, n in line]


def expand(spec):
    """The rows; one with `each_task` becomes a row for every task of its suite."""
    for row in spec["rows"]:
        if not row.get("each_task"):
            yield row
            continue
        at = address(spec, row, spec["columns"][0])
        for task in record.load(at["file"]).tasks(at["suite"]):
            yield {**row, "label": task, "task": task}


def address(spec, row, column):
    found = {"figure": "precision"}
    for part in (spec, row, column):
        found.update({field: part[field] for field in FIELDS if field in part})
    if "fill" in column:
        found["policy"] = found["policy"].replace("{}", column["fill"])
    return found


def value(at):
    """The figure at an address, the mean over seeds for `seed-*`; None where there is none."""
    found = over_seeds(at)
    return None if None in found else sum(found) / len(found)


def spread(at):
    """Half of the 95 % interval over seeds (Student's t); None for a single figure."""
    found = over_seeds(at)
    if len(found) == 1 or None in found:
        return None
    return STUDENT[len(found)] * statistics.stdev(found) / len(found) ** 0.5


def over_seeds(at):
    """The figures of every seed."""
    for field in ("file", "suite", "policy"):
        if field not in at:
            raise Missing(f"no {field} in the address {at}")
    found = record.load(at["file"])
    seeds = [p for p in found.policies(at["suite"]) if p == at["policy"] or any_seed(p) == at["policy"]]
    if not seeds:
        raise Missing(f"results/{found.name}.json has no {at['policy']} in {at['suite']}")
    return [found.figure(at["figure"], at["suite"], p, at.get("task")) for p in seeds]


def any_seed(policy):
    """The name that stands for a policy's runs with every seed."""
    return re.sub(r"seed-\d+", "seed-*", policy)


def form(number, figure, digits=5):
    if number is None:
        return ""
    if figure == "jams":
        return str(int(number))
    if figure in ("path", "jerk", "path_worst", "jerk_worst", "to_cubic"):
        return f"{number:.2f}"
    if figure == "excess":
        return f"{number:+.0%}".replace("%", " %") if number < 2 else f"{1 + number:.0f} times"
    return decimals(number, digits)


def decimals(number, digits):
    """`.00012`; a figure that rounds to nothing is said to be smaller than the last digit."""
    if 0 < number < 0.5 * 10**-digits:
        return "<." + "0" * (digits - 1) + "1"
    text = f"{number:.{digits}f}"
    return text[1:] if text.startswith("0.") else text


def noted(spec):
    """A table that was measured once, as it is in its file."""
    found = record.load(spec["file"]).data
    above = f"{found['why']}.\n\n" if spec.get("caption") else ""
    return above + markdown.table(found["head"], found["rows"]), [spec["file"]]


def datasets(spec):
    """One row for each dataset of some records: frames, and how clean they are."""
    rows = []
    for row in spec["rows"]:
        facts = record.load(row["file"]).data["data"][row["path"]]
        shares = (share(facts[key]) for key in ("at_stop", "self_contact", "cells"))
        rows.append([row["label"], f"{facts['frames']:,}", *shares, f"`{facts['manifest_sha256'][:8]}`"])
    head = ["data", "frames", "a joint at a stop", "self-contact", "cells visited", "sha256 of the manifest"]
    return markdown.table(head, rows), [row["file"] for row in spec["rows"]]


def share(number):
    return f"{100 * number:.0f} %"


def index(spec):
    """All files: what they hold, how to measure them again, and of which commit they are."""
    rows = []
    for found in record.every():
        data = found.data
        lines = [*data.get("make", []), data["command"]] if "command" in data else data["commands"]
        shown = "; ".join(f"`{line}`" for line in lines)
        commits = [f"`{data['commit']}`", *(f"{p}: `{c}`" for p, c in data.get("again", {}).items())]
        rows.append([f"[{found.name}]({found.name}.json)", data["why"], shown, ", ".join(commits)])
    return markdown.table(["file", "what it says", "commands", "commit"], rows), []


KINDS = {"cells": cells, "noted": noted, "datasets": datasets, "index": index}
