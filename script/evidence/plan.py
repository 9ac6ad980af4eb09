"""What is measured, and how: the entries of results/plan.toml."""

import shlex
import tomllib

from .record import FOLDER


class Unknown(Exception):
    """No entry has this name."""


def entries():
    """Name to entry: `why`, `run` (the measuring command) and perhaps `make` and `before`.

    `make` is a list of `[path, command]`: what must be there first, and the command that makes it. `before` is a
    change of the program that came after the file was measured, if its figures would be others today.
    """
    return tomllib.loads((FOLDER / "plan.toml").read_text())


def entry(name):
    found = entries()
    if name not in found:
        raise Unknown(f"results/plan.toml has no {name}; there are {', '.join(sorted(found))}")
    return found[name]


def option(command, name):
    """The value of an option of a command line; None where it is not given."""
    words = shlex.split(command)
    return words[words.index(name) + 1] if name in words else None
