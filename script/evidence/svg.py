"""What the plots share: a white page, an axis, marks that differ in shape and in colour."""

import html

INK, PALE = "#24292f", "#d0d7de"
COLOURS = ["#0969da", "#bf3989", "#1a7f37", "#9a6700", "#8250df", "#57606a"]


def page(width, height, title, parts):
    head = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'font-family="sans-serif" font-size="13" fill="{INK}">',
        f"<title>{html.escape(title)}</title>",
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        text(12, 22, title, size=15),
    ]
    return "\n".join([*head, *parts, "</svg>"]) + "\n"


def text(x, y, words, anchor="start", size=None):
    sized = f' font-size="{size}"' if size else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{sized}>{html.escape(words)}</text>'


def line(x1, y1, x2, y2, colour=PALE, width=1):
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}" stroke-width="{width}"/>'


def path(points, k):
    """A curve in the k-th colour."""
    through = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{through}" fill="none" stroke="{colour(k)}" stroke-width="1.6"/>'


def colour(k):
    return COLOURS[k % len(COLOURS)]


def mark(k, x, y):
    """The k-th mark."""
    shapes = [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{colour(k)}"/>',
        f'<rect x="{x - 4.5:.1f}" y="{y - 4.5:.1f}" width="9" height="9" fill="{colour(k)}"/>',
        f'<path d="M{x:.1f} {y - 6:.1f}l6 10h-12z" fill="{colour(k)}"/>',
        f'<path d="M{x:.1f} {y - 6:.1f}l6 6l-6 6l-6 -6z" fill="{colour(k)}"/>',
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="none" stroke="{colour(k)}" stroke-width="2"/>',
        f'<path d="M{x - 5:.1f} {y - 5:.1f}l10 10m0 -10l-10 10" stroke="{colour(k)}" stroke-width="2"/>',
    ]
    return shapes[k % len(shapes)]


def legend(x, y, labels):
    parts = []
    for k, label in enumerate(labels):
        parts += [mark(k, x, y - 4), text(x + 10, y, label)]
        x += 34 + 7.2 * len(label)
    return parts
