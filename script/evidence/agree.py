"""Cells that two files share: the same policy on the same task of the same robot and plant.

After a change of the program only some files are measured again. Where the figures of two files then differ, the
older one is out of date, and its other figures may be, too. An entry of the plan whose file is known to be older says
so as `before`, with the change that came after it; it is left out here.
"""

from . import plan, record, verify

# What else a Precision depends on.
OPTIONS = ("--plant", "--seeds", "--data", "--data-seed", "--cases")


def differing():
    """What differs, in words: one line for each pair of files."""
    known, entries = {}, plan.entries()
    for found in record.every():
        if found.data["kind"] != "eval" or "before" in entries.get(found.name, {}):
            continue
        rest = tuple(plan.option(found.data["command"], option) for option in OPTIONS)
        made = found.data.get("make") or []
        for suite, policy, task, value in found.cells():
            # What was collected or trained for a file belongs to it.
            if not (":" in policy and made):
                known.setdefault((found.data["robot"], *rest, suite, policy, task), []).append((found.name, value))
    pairs = {}
    for cells in known.values():
        (first, value), *others = cells
        for name, other in others:
            if not verify.agree(value, other):
                pairs[first, name] = pairs.get((first, name), 0) + 1
    return [f"results/{a}.json and results/{b}.json differ in {n} of the cells that both have" for (a, b), n in pairs.items()]
