"""The `robert` program: where it is, and one call of it."""

import json
import os
import pathlib
import shlex
import subprocess

from .record import ROOT


class Failed(Exception):
    """The program ended with an error."""


def binary():
    """`ROBERT_BIN`, else the release build, else the debug build, else the one on the PATH."""
    named = os.environ.get("ROBERT_BIN")
    built = [ROOT / "target/release/robert", ROOT / "target/debug/robert"]
    return named or next((str(b) for b in built if b.is_file()), "robert")


def call(arguments):
    """Runs it in the project's folder with a list or a line of arguments; its stdout."""
    arguments = shlex.split(arguments) if isinstance(arguments, str) else arguments
    try:
        ran = subprocess.run([binary(), *arguments], cwd=ROOT, capture_output=True, text=True)
    except OSError as error:
        raise Failed(f"{binary()}: {error.strerror}; build it: cargo build --release") from None
    if ran.returncode != 0:
        raise Failed(f"robert {shlex.join(arguments)}: exit code {ran.returncode}\n{ran.stderr.strip()}")
    return ran.stdout


def report(arguments):
    """The JSON document that a call with `--json` prints."""
    arguments = shlex.split(arguments) if isinstance(arguments, str) else arguments
    return json.loads(call([*arguments, "--json", "--quiet"]))


def commit():
    """The commit of the checkout, and whether the program's sources differ from it."""
    def git(*words):
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True).stdout.strip()
    changed = git("status", "--porcelain", "--", "src", "assets", "Cargo.toml", "Cargo.lock")
    return git("rev-parse", "--short=12", "HEAD") + ("+changes" if changed else "")
