"""Markdown tables."""


def cell(text):
    """A cell's text: one line, no bars that would end it."""
    return " ".join(str(text).split()).replace("|", "\\|")


def table(head, rows):
    lines = [list(map(cell, row)) for row in [head, *rows]]
    lines.insert(1, ["---"] * len(head))
    return "\n".join("| " + " | ".join(row) + " |" for row in lines)
