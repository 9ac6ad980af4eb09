"""What a measurement depended on besides the program: hashes of robots, clips, models and data.

`stale` compares the hashes of a record with the files of today, so that a table cannot outlive
the model or the clips that it was measured with.
"""

import functools
import hashlib
import json
import struct
import tomllib

from .record import ROOT

ASSETS = ROOT / "assets"

# The suite `final` is these together, as in src/rollout/tasks/mod.rs.
FINAL = ["drawn-final", "fast-final", "touch-final"]


def of_model(path):
    """Weights and settings of a model file; its notes and origin may change without a new hash."""
    raw = path.read_bytes()
    (length,) = struct.unpack("<Q", raw[:8])
    header = json.loads(raw[8 : 8 + length])
    card = json.loads(header.pop("__metadata__")["robert"])
    del card["training"]
    settings = json.dumps([header, card], sort_keys=True).encode()
    return digest(settings + raw[8 + length :])


def of_robot(robot):
    """The MJCF and the profile without its prose."""
    profile = tomllib.loads((ASSETS / "robots" / robot / "profile.toml").read_text())
    owner = profile.get("model", "").removeprefix("builtin:")
    folder = robot if not owner or owner.endswith(".xml") else owner
    return digest(_without_prose(profile) + (ASSETS / "robots" / folder / "robot.xml").read_bytes())


def of_clips(robot, suites):
    """The clips of some suites without their prose."""
    found = [json.loads(clip.read_text()) for suite in suites for clip in clips(robot, suite)]
    return digest(b"".join(map(_without_prose, found)))


def _without_prose(document):
    kept = {k: v for k, v in document.items() if k not in ("about", "title", "description", "licence", "notes")}
    return json.dumps(kept, sort_keys=True).encode()


@functools.cache
def listed():
    """The lists of clips, by robot and suite."""
    return tomllib.loads((ASSETS / "clips/suites.toml").read_text())


def clips(robot, suite):
    """The clip files of a built-in suite; empty for suites that are extracted from data."""
    all_suites = listed()
    owner = all_suites.get(robot, {}).get("like", robot)
    parts = FINAL if suite == "final" else [suite]
    names = [name for part in parts for name in all_suites.get(owner, {}).get(part, [])]
    return [ASSETS / "clips" / owner / f"{name}.clip.json" for name in names]


def digest(data):
    return hashlib.sha256(data).hexdigest()[:16]


def today(robot, suites, policies):
    """Hashes of everything built in that an evaluation uses."""
    found = {"robot": of_robot(robot)}
    built_in = [s for s in suites if clips(robot, s)]
    if built_in:
        found["clips"] = of_clips(robot, built_in)
    for name in sorted({model(p) for p in policies} - {None}):
        path = ASSETS / "models" / robot / f"{name}.safetensors"
        if path.is_file():
            found[f"model {name}"] = of_model(path)
    return found


def model(policy):
    """Name of the built-in model that a policy uses; None if it uses none."""
    name = policy.split("+")[0]
    kind, _, given = name.partition(":")
    return (given or "robert") if kind in ("robert", "ridge", "auto") else None


def stale(record):
    """Which hashes of a record are not those of today."""
    if record.data["kind"] != "eval":
        return []
    suites = record.suites()
    policies = sorted({p for s in suites.values() for p in s["policies"]})
    now = today(record.data["robot"], list(suites), policies)
    then = record.data["inputs"]
    # Also those of inputs that are gone.
    return [key for key in {**then, **now} if then.get(key) != now.get(key)]
