"""The figures on the cards of the built-in models: those of results/ROBOT.json.

A card is JSON inside the header of its safetensors file. Training writes the figures of its last
evaluation there; a later program may be better or worse with the same weights. Only the figures
are rewritten, and only when one is off by more than 2 %, because the files are large.
"""

import json
import struct

from . import inputs, record

SUITES = ("extra", "manual")
# How each model is listed by `robert models ls`.
POLICIES = {"robert": "robert", "faithful": "robert:faithful", "adaptive": "robert:adaptive+guide"}


def read(path):
    """Header text, its length with the length's own bytes, and the card's text."""
    raw = path.read_bytes()
    (length,) = struct.unpack("<Q", raw[:8])
    header = raw[8 : 8 + length].decode()
    return raw, header, json.loads(header)["__metadata__"]["robert"]


def measured(robot, name):
    """Precision by suite and by task, as the card has it."""
    found, policy = record.load(robot), POLICIES[name]
    figures = {}
    for suite in SUITES:
        figures[suite] = found.figure("precision", suite, policy)
        for task in found.tasks(suite):
            figures[f"{suite}/{task}"] = found.figure("precision", suite, policy, task)
    return dict(sorted(figures.items()))


def wrong():
    """Model files whose card differs from what was measured."""
    files = sorted((inputs.ASSETS / "models").glob("*/*.safetensors"))
    return [path for path in files if path.stem in POLICIES and _differs(path)]


def _differs(path):
    on_card = json.loads(read(path)[2])["training"]["precision"]
    now = measured(path.parent.name, path.stem)
    return any(abs(on_card.get(suite, 0) - now[suite]) > 0.02 * now[suite] for suite in SUITES)


def write(path):
    """Puts the measured figures on a card; every other byte of the header stays."""
    raw, header, card = read(path)
    start = card.index('"precision":{')
    end = card.index("}", start) + 1
    figures = json.dumps(measured(path.parent.name, path.stem), separators=(",", ":"))
    new = f'{card[:start]}"precision":{figures}{card[end:]}'
    quoted = [json.dumps(text, ensure_ascii=False) for text in (card, new)]
    if header.count(quoted[0]) != 1:
        raise record.Missing(f"{path}: the card is not written as expected")
    text = header.replace(*quoted).rstrip(" ").encode()
    text += b" " * (-len(text) % 8)
    path.write_bytes(struct.pack("<Q", len(text)) + text + raw[8 + len(header.encode()) :])
