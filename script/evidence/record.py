"""A result file: what was measured, by which command, on which data.

A record of kind `eval` holds figures by suite, policy and task. `noted` is a table that was measured by the commands it names, at the commit it
names, and that this script cannot measure again.
"""

import json
import pathlib

ROOT = pathlib.Path(__file__).resolve().parents[2]
FOLDER = ROOT / "results"

# Figures of one task, in the order of the lists in the files. Older files end with `du`.
FIGURES = [
    "precision", "moving", "masked", "path", "overshoot", "jerk", "jams", "du",
    "path_worst", "jerk_worst", "to_cubic",
]


class Missing(Exception):
    """A figure that a page asks for and no file holds."""


class Record:
    def __init__(self, data):
        self.data = data
        self.name = data["name"]

    def suites(self):
        return self.data["suites"]

    def policies(self, suite):
        if suite not in self.suites():
            raise Missing(f"results/{self.name}.json has no suite {suite}")
        return list(self.suites()[suite]["policies"])

    def tasks(self, suite):
        return self.suites()[suite]["tasks"]

    def _of(self, suite, policy):
        try:
            return self.suites()[suite], self.suites()[suite]["policies"][policy]
        except KeyError as key:
            raise Missing(f"results/{self.name}.json has no {key} ({suite}, {policy})") from None

    def figure(self, figure, suite, policy, task=None):
        """One figure of a task, or of a suite: the mean over its tasks (jams: the sum; the worst gap: the largest).

        `floor` is the Precision of iLQR. `excess` is Precision / floor - 1; that of a suite is
        the ratio of the means. None where the task has no such figure, and
        for the Precision of a suite of which a rollout diverged.
        """
        whole, found = self._of(suite, policy)
        if figure == "ci95":
            return found.get("ci95")
        if figure == "floor":
            values = whole["floor"]
        elif figure == "excess":
            floor, own = (self.figure(f, suite, policy, task) for f in ("floor", "precision"))
            return None if floor is None or floor < 1e-5 else own / floor - 1
        elif figure in FIGURES:
            at = FIGURES.index(figure)
            values = [row[at] if at < len(row) else None for row in found["tasks"]]
        else:
            raise Missing(f"there is no figure {figure}; there are {FIGURES}, floor, excess, ci95")
        if task is not None:
            if task not in whole["tasks"]:
                raise Missing(f"results/{self.name}.json: no task {task} in {suite}")
            return values[whole["tasks"].index(task)]
        known = [v for v in values if v is not None]
        # A rollout that diverged has no Precision, and a mean without it would be too good.
        if not known or figure == "precision" and len(known) < len(values):
            return None
        if figure.endswith("_worst"):
            return max(known)
        return sum(known) if figure == "jams" else sum(known) / len(known)

    def cells(self):
        """Every measured Precision: (suite, policy, task, value)."""
        if self.data["kind"] != "eval":
            return
        for suite, whole in self.suites().items():
            for policy, found in whole["policies"].items():
                for task, row in zip(whole["tasks"], found["tasks"]):
                    yield suite, policy, task, row[0]

    def text(self):
        """The file's text: lists of plain values on one line, everything else indented."""
        return _text(self.data, 0) + "\n"

    def save(self):
        FOLDER.mkdir(exist_ok=True)
        (FOLDER / f"{self.name}.json").write_text(self.text())


def load(name):
    path = FOLDER / f"{name}.json"
    try:
        record = Record(json.loads(path.read_text()))
    except FileNotFoundError:
        raise Missing(f"there is no results/{name}.json; script/results --run {name} makes it") from None
    if record.name != name:
        raise Missing(f"results/{name}.json calls itself {record.name}")
    return record


def every():
    return [load(path.stem) for path in sorted(FOLDER.glob("*.json"))]


def short(value):
    """Six significant digits: more than any table shows, and small files."""
    return float(f"{value:.6g}") if isinstance(value, float) else value


def _text(value, depth):
    pad = " " * (depth + 1)
    if isinstance(value, dict) and value:
        inner = ",\n".join(f"{pad}{json.dumps(k)}: {_text(v, depth + 1)}" for k, v in value.items())
        return "{\n" + inner + "\n" + " " * depth + "}"
    if isinstance(value, list) and any(isinstance(v, (dict, list)) for v in value):
        return "[\n" + ",\n".join(pad + _text(v, depth + 1) for v in value) + "\n" + " " * depth + "]"
    return json.dumps(value, ensure_ascii=False)
