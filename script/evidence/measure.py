"""Makes a record from an entry of the plan: prepares data, measures, keeps what tables need."""

import csv
import pathlib
import re
import shlex
import tempfile

from . import inputs, plan, robert
from .record import FIGURES, ROOT, Record, load, short


def run(name, commit=None, say=print, policies=None):
    """Measures one entry of the plan; with `policies` only these columns of its record, again."""
    if policies:
        return again(name, policies, commit or robert.commit(), say)
    entry = plan.entry(name)
    prepare(entry, say)
    say(f"robert {entry['run']}")
    commit = commit or robert.commit()
    if not entry.get("curves"):
        return record(name, entry, robert.report(entry["run"]), commit)
    with tempfile.TemporaryDirectory() as folder:
        report = robert.report(f"{entry['run']} --out {folder}")
        found = record(name, entry, report, commit)
        found.data["curves"] = curves(pathlib.Path(folder) / "errors.csv", report, entry["curves"])
        return found


def again(name, policies, commit, say):
    """The record of an entry with some of its policies measured again by the program of today."""
    entry, old = plan.entry(name), load(name)
    asked = plan.option(entry["run"], "--policy")
    if entry.get("curves") or old.data["kind"] != "eval":
        raise plan.Unknown(f"{name} is measured as a whole only")
    if keys := inputs.stale(old):
        raise plan.Unknown(f"{name} was measured with another {', '.join(keys)}: measure all of it")
    if unknown := [p for p in policies if p not in asked.split(",")]:
        raise plan.Unknown(f"{name} does not measure {', '.join(unknown)}")
    part = {**entry, "run": entry["run"].replace(f"--policy {asked}", f"--policy {','.join(policies)}")}
    prepare(entry, say)
    say(f"robert {part['run']}")
    found = evaluation(part, robert.report(part["run"]))
    same = ("plant", "seeds", "data", "robot")
    if changed := [key for key in same if found[key] != old.data[key]]:
        raise plan.Unknown(f"{name} was measured with another {', '.join(changed)}: measure all of it")
    for suite, new in found["suites"].items():
        known = old.data["suites"].get(suite, {"tasks": None})
        if known["tasks"] != new["tasks"]:
            raise plan.Unknown(f"{name} was measured on other tasks of {suite}: measure all of it")
        known["policies"].update(new["policies"])
    old.data["command"], old.data["figures"] = f"robert {entry['run']}", FIGURES
    old.data["inputs"].update(found["inputs"])
    old.data.setdefault("again", {}).update(dict.fromkeys(policies, commit))
    return old


def prepare(entry, say=print):
    """Makes the data and fits that an entry needs, unless they are there."""
    for path, command in entry.get("make", []):
        if not (ROOT / path).exists():
            say(f"robert {command}")
            robert.call(command)


def record(name, entry, report, commit):
    """A record of what a command reported."""
    kind = shlex.split(entry["run"])[0]
    if kind != "eval":
        raise plan.Unknown(f"{name}: `{kind}` is no measurement; it can be a command of `make`")
    head = {
        "name": name, "kind": kind, "why": entry["why"], "commit": commit,
        "version": robert.call("--version").strip(),
        "make": [f"robert {command}" for _, command in entry.get("make", [])],
        "command": f"robert {entry['run']}",
    }
    return Record({**head, **evaluation(entry, report)})


def evaluation(entry, report):
    suites = {}
    asked = plan.option(entry["run"], "--policy").split(",")
    for result in report["results"]:
        tasks = result["tasks"]
        policy = as_asked(result["policy"], asked)
        suite = suites.setdefault(result["suite"], {
            "tasks": [t["name"] for t in tasks],
            "floor": [short(t.get("floor")) for t in tasks],
            "policies": {},
        })
        found = suite["policies"][policy] = {"tasks": [figures(t) for t in tasks]}
        if result.get("ci95") is not None:
            found["ci95"] = short(result["ci95"])
    return {
        "robot": report["robot"], "unit": report["unit"], "seeds": report["seeds"],
        "plant": report["plant"], "near_limit": {s["name"]: short(s["near_limit_share"]) for s in report["suites"]},
        "data": {path: origin(ROOT / path) for path, _ in entry.get("make", [])},
        "inputs": inputs.today(report["robot"], list(suites), asked),
        "figures": FIGURES, "suites": suites,
    }


def as_asked(label, asked):
    """A policy as the command names it: the program leaves a path out where it is not ambiguous."""
    if label in asked:
        return label
    (found,) = [name for name in asked if re.sub(":[^+]*", "", name) == label]
    return found


def curves(file, report, tasks):
    """The error at every frame by task and policy; None at frames without a goal."""
    frames = {t["name"]: t["frames"] for r in report["results"] for t in r["tasks"]}
    found = {}
    with file.open(newline="") as rows:
        for row in csv.DictReader(rows):
            task, policy, frame = row["task"], row["policy"], int(row["frame"])
            if task not in tasks:
                continue
            curve = found.setdefault(task, {}).setdefault(policy, [None] * frames[task])
            curve[frame - 1] = float(f"{float(row['error']):.3g}")
    return found


def figures(task):
    """One task's row, in the order of FIGURES."""
    gap = task.get("gap") or {}
    jams = task.get("jams")
    row = {
        "precision": task["precision"], "moving": task.get("moving"), "masked": task.get("masked_mae"),
        "path": gap.get("path"), "overshoot": (gap.get("overshoot") or {}).get("value"),
        "jerk": gap.get("jerk"), "jams": None if jams is None else len(jams), "du": task.get("mean_abs_du"),
        "path_worst": (gap.get("path_worst") or {}).get("value"),
        "jerk_worst": (gap.get("jerk_worst") or {}).get("value"),
        "to_cubic": gap.get("to_cubic"),
    }
    return [short(row[name]) for name in FIGURES]


def _short(value):
    """The same with every number rounded."""
    if isinstance(value, dict):
        return {k: _short(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_short(v) for v in value]
    return short(value)


def origin(path):
    """Hash of a file; of a dataset its manifest's hash, and how clean it is."""
    if path.is_file():
        return {"sha256": inputs.digest(path.read_bytes())}
    found = robert.report(f"dataset info {path.relative_to(ROOT)}")
    facts = found["statistics"]
    return _short({
        "manifest_sha256": found["manifest_sha256"][:16], "agents": facts["agents"],
        "frames": found["totals"]["frames"], "self_contact": facts["self_contact"],
        "at_stop": facts["near_limit_any"], "cells": facts["coverage"],
    })
