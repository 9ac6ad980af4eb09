"""Random cells of the result files, measured again.

A cell is the Precision of one policy on one task. The same program on the same kind of processor
gives the same bits. Another processor adds numbers in another order, and a contact that is missed
by a hair changes the rest of a rollout. A cell agrees when it is within TOLERANCE.
"""

import random
import shlex

from . import inputs, measure, plan, record, robert

RELATIVE = 0.05
ABSOLUTE = 2e-5
# The parts of `--suite test`, by the share of hidden frames.
EXTRACTED = ("test", "test_low_mask", "test_high_mask")
TOLERANCE = f"{RELATIVE:.0%} of the figure or {ABSOLUTE}, whichever is larger".replace("%", " %")


def draw(count, seed, wanted=None, needs_data=False):
    """Cells drawn evenly from all files; those that need data first only if asked for."""
    cells = [
        (found, *cell)
        for found in record.every()
        if wanted is None or found.name in wanted
        if needs_data or not found.data.get("make")
        for cell in found.cells()
    ]
    if not cells:
        raise record.Missing("no file of results/ has cells that can be repeated")
    return random.Random(seed).sample(cells, min(count, len(cells)))


def pick(address):
    """The cell FILE/SUITE/POLICY/TASK."""
    name, *rest = address.split("/")
    found = record.load(name)
    for cell in found.cells():
        if "/".join(cell[:3]) == "/".join(rest):
            return (found, *cell)
    raise record.Missing(f"there is no cell {address}; it is FILE/SUITE/POLICY/TASK")


def command(found, suite, policy, task):
    """The command that measures one cell again."""
    robot = found.data["robot"]
    line = ["eval", "--robot", robot, "--policy", policy, "--no-floor"]
    for option in ("--plant", "--seeds", "--data", "--data-seed", "--cases"):
        given = plan.option(found.data["command"], option)
        line += [option, given] if given else []
    if suite in EXTRACTED:
        # These tasks exist only within their suite.
        return [*line, "--suite", "test"]
    clip = next((c for c in inputs.clips(robot, suite) if c.name == f"{task}.clip.json"), None)
    if clip is None:
        raise record.Missing(f"{found.name}: the suite {suite} of {robot} has no clip {task}")
    return [*line, "--suite", str(clip.relative_to(record.ROOT))]


def unrepeatable():
    """Cells whose task is in no suite of today, in words."""
    wrong = []
    for found in record.every():
        for suite, policy, task, _ in found.cells():
            try:
                command(found, suite, policy, task)
            except record.Missing as error:
                wrong.append(str(error))
    return sorted(set(wrong))


def repeat(found, suite, policy, task):
    """The cell's Precision today."""
    if found.data.get("make"):
        measure.prepare(plan.entry(found.name))
    report = robert.report(command(found, suite, policy, task))
    for result in report["results"]:
        for row in result["tasks"]:
            if row["name"] == task and result["suite"] in (suite, "files"):
                return row["precision"]
    raise record.Missing(f"{found.name}: the program reports no {suite}/{task}")


def agree(then, now):
    if then is None or now is None:
        return then is now
    return abs(now - then) <= max(RELATIVE * abs(then), ABSOLUTE)


def run(cells, say=print):
    """Repeats cells; how many of them disagree."""
    wrong = 0
    for found, suite, policy, task, then in cells:
        now = repeat(found, suite, policy, task)
        good = agree(then, now)
        wrong += not good
        then, now = ("failed" if p is None else f"{p:.6f}" for p in (then, now))
        say(f"{'agrees' if good else 'DIFFERS'}: {found.name} {suite}/{task} {policy}: {then} in the file, {now} now")
        say(f"  robert {shlex.join(command(found, suite, policy, task))}")
    return wrong
