"""The marked blocks of the Markdown pages.

    <!-- results: NAME -->      a table of results/tables.toml
    <!-- end -->

    <!-- results: =FILE/SUITE/POLICY -->.00027<!-- end -->      one figure inside a sentence;
    also =FILE/SUITE/POLICY/TASK, and with ::FIGURE or ::FIGURE.DIGITS behind either

    <!-- results: =FILE#ROW#2 -->.0768<!-- end -->      the second cell behind ROW, in a table that was
    measured once; =FILE#DATASET#KEY is a fact of the data of a file. Spaces in a name are _ here.
"""

import os
import re
import tomllib

from . import curves, dots, record, table, trend
from .record import FOLDER, ROOT, Missing

BLOCK = re.compile(r"<!-- results: (\S+) -->(.*?)<!-- end -->", re.DOTALL)
PLOTS = {"dots": dots.draw, "curves": curves.draw, "trend": trend.draw}


def pages():
    """Every page that may hold results."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), FOLDER / "README.md"]


def specs():
    return tomllib.loads((FOLDER / "tables.toml").read_text())


def written():
    """What every page, plot and index holds when it is right: path to text."""
    found, known, used = {}, specs(), set()
    for path in pages():
        if path.is_file():
            found[path] = fill(path, known, used)
    for name, spec in known.items():
        if spec.get("kind") in PLOTS:
            found[ROOT / spec["out"]] = PLOTS[spec["kind"]](spec)
            used.add(name)
    unused = sorted(set(known) - used)
    if unused:
        raise Missing(f"no page shows {', '.join(unused)} of results/tables.toml")
    return found


def fill(path, known, used):
    """A page's text with every block made anew."""
    def one(block):
        name = block[1]
        if name.startswith("="):
            show = noted if "#" in name else inline
            return f"<!-- results: {name} -->{show(name[1:])}<!-- end -->"
        if name not in known:
            line = path.read_text()[: block.start()].count("\n") + 1
            raise Missing(f"{path.relative_to(ROOT)}:{line}: results/tables.toml has no {name}")
        used.add(name)
        text, files = table.render(known[name])
        below = f"\n\n{sources(path, files)}" if files else ""
        return f"<!-- results: {name} -->\n{text}{below}\n<!-- end -->"
    return BLOCK.sub(one, path.read_text())


def inline(text):
    """One figure: FILE/SUITE/POLICY[/TASK][::FIGURE[.DIGITS]]."""
    at, _, after = text.rpartition("::")
    at, figure = (at, after) if at else (text, "precision")
    figure, _, digits = figure.partition(".")
    file, suite, rest = (*at.split("/", 2), "", "")[:3]
    # A policy may be a path, so it is looked up instead of split off.
    known = [name for p in record.load(file).policies(suite) for name in (p, table.any_seed(p))]
    named = [p for p in known if rest == p or rest.startswith(f"{p}/")]
    if not named:
        raise Missing(f"={text}: no such policy in results/{file}.json")
    policy = max(named, key=len)
    where = {"file": file, "suite": suite, "policy": policy, "figure": figure}
    where |= {"task": rest[len(policy) + 1 :]} if rest != policy else {}
    number = table.value(where)
    if number is None:
        raise Missing(f"={text}: the file has no such figure")
    return table.form(number, figure, int(digits or 5))


def noted(text):
    """One cell of a table that was measured once, or one fact of a dataset."""
    file, label, which = text.split("#")
    data = record.load(file).data
    if data["kind"] != "noted":
        fact = data.get("data", {}).get(label, {}).get(which)
        if fact is None:
            raise Missing(f"={text}: the file has no such fact")
        return f"{fact:,}" if isinstance(fact, int) else table.share(fact)
    rows = [row for row in data["rows"] if plain(row[0]).replace(" ", "_") == label]
    if len(rows) != 1 or not which.isdigit() or not 0 < int(which) < len(rows[0]):
        raise Missing(f"={text}: the file has no such cell")
    return plain(rows[0][int(which)])


def plain(cell):
    """A cell's text without marks."""
    return cell.replace("*", "").replace("`", "")


def sources(path, files):
    """The line below a table: where its figures and their commands are."""
    there = os.path.relpath(FOLDER, path.parent)
    links = [f"[{name}]({there}/{name}.json)" for name in dict.fromkeys(files)]
    return f"*Figures and commands: {', '.join(links)}.*"


def differing():
    """The paths whose text is not what the files say."""
    return [path for path, text in written().items() if not path.is_file() or path.read_text() != text]


def write():
    """Rewrites what differs; the paths."""
    changed = []
    for path, text in written().items():
        if not path.is_file() or path.read_text() != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
            changed.append(path)
    return changed
