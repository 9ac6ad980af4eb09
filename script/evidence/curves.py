"""The error over time: a small chart for each task, a curve for each policy."""

import math

from . import record, svg

WIDTH, HEIGHT, LEFT, TOP, GAP = 860, 140, 62, 74, 52
SECS = 0.05  # a frame


def draw(spec):
    """The picture as SVG text."""
    found = record.load(spec["file"])
    tasks = spec.get("tasks") or list(found.data["curves"])
    policies = spec["policies"]
    columns = spec.get("columns", 1)
    each = WIDTH / columns
    height = HEIGHT / columns**0.5
    step = 2 * columns
    parts = svg.legend(LEFT, 42, policies)
    for i, task in enumerate(tasks):
        curves = found.data["curves"][task]
        left = LEFT + i % columns * each
        top = TOP + i // columns * (height + GAP)
        shown = [curves[p] for p in policies]
        high = tick(max(v for c in shown for v in c if v is not None))
        frames = max(len(c) for c in shown)

        def at(frame, value, left=left, top=top, high=high, frames=frames):
            return (
                left + frame / frames * (each - LEFT - 20),
                top + height * (1 - min(value, high) / high),
            )

        for share in (0, 0.5, 1):
            x, y = at(0, high * share)
            name = f"{high * share:g}".removeprefix("0") or "0"
            parts += [svg.line(x, y, left + each - LEFT - 20, y), svg.text(x - 6, y + 4, name, "end", 11)]
        for second in range(0, int(frames * SECS) + 1, step):
            x, y = at(second / SECS, 0)
            parts.append(svg.text(x, y + 14, f"{second} s", "middle", 11))
        parts.append(svg.text(left, top - 8, f"{task}, {found.data['unit']}"))
        for k, curve in enumerate(shown):
            parts += [svg.path(run, k) for run in runs(curve, at)]
    return svg.page(WIDTH, TOP + math.ceil(len(tasks) / columns) * (height + GAP), spec["title"], parts)


def tick(number):
    """The next of 1, 2, 4 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(number))
    return next(m * power for m in (1, 2, 4, 10) if m * power >= number)


def runs(curve, at):
    """The stretches of frames that have a goal; masked frames between them are gaps in the curve."""
    stretch = []
    for frame, value in enumerate([*curve, None], start=1):
        if value is not None:
            stretch.append(at(frame, value))
        elif stretch:
            yield stretch if len(stretch) > 1 else [stretch[0], (stretch[0][0] + 1.5, stretch[0][1])]
            stretch = []
