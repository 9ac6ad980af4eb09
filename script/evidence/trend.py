"""A figure of runs against the amount of data, on logarithmic axes, with fitted lines.

Each series of a noted table is one size of network, with one column for each seed. Through the means
of the seeds goes a solid line, through the best seeds a dashed one; the shade is the 95 % band of the
line through all runs.
"""

import math
import statistics

from . import record, svg

WIDTH, HEIGHT, LEFT, TOP, BOTTOM = 860, 420, 74, 62, 48
# 97.5 % quantile of Student's t by degrees of freedom, from one on.
STUDENT = (
    *(12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228),
    *(2.201, 2.179, 2.160, 2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086),
)


def draw(spec):
    """The picture as SVG text."""
    table = record.load(spec["file"]).data
    series = [points(table, s["columns"]) for s in spec["series"]]
    xs = [x for found in series for x, _ in found]
    ys = [y for found in series for _, y in found]
    left, right = math.log10(min(xs)) - 0.15, math.log10(max(xs)) + 0.15
    low, high = math.log10(min(ys)) - 0.15, math.log10(max(ys)) + 0.15

    def at(x, y):
        across = (math.log10(x) - left) / (right - left)
        up = (math.log10(y) - low) / (high - low)
        return LEFT + across * (WIDTH - LEFT - 24), TOP + (1 - up) * (HEIGHT - TOP - BOTTOM)

    parts = grid(spec, at, sorted(set(xs)), [10**low, 10**high])
    for k, found in enumerate(series):
        parts += series_of(k, found, at)
    parts += svg.legend(LEFT, 42, [s["label"] for s in spec["series"]])
    return svg.page(WIDTH, HEIGHT, spec["title"], parts)


def points(table, columns):
    """(amount, figure) of every run that is in the table."""
    at = [table["head"].index(c) for c in columns]
    return [
        (float(row[0].replace(",", "")), float(row[i])) for row in table["rows"] for i in at if row[i]
    ]


def grid(spec, at, amounts, ends):
    parts = []
    for tick in (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0):
        if ends[0] <= tick <= ends[1]:
            (x, y), (far, _) = at(amounts[0], tick), at(amounts[-1], tick)
            parts += [svg.line(LEFT, y, far + 16, y)]
            parts += [svg.text(LEFT - 8, y + 4, f"{tick:g}".removeprefix("0"), "end")]
    for amount in amounts:
        x, _ = at(amount, ends[0])
        parts += [svg.text(x, HEIGHT - BOTTOM + 20, f"{amount:,.0f}", "middle")]
    middle = (LEFT + WIDTH) / 2
    return [*parts, svg.text(middle, HEIGHT - 8, spec["axis"], "middle")]


def series_of(k, found, at):
    """Marks of the runs, both lines, and the band."""
    amounts = sorted({x for x, _ in found})
    parts = []
    if len(amounts) > 2:
        line, spread = fit(found)
        steps = [amounts[0] * (amounts[-1] / amounts[0]) ** (i / 40) for i in range(41)]
        upper = [at(x, 10 ** (line(x) + spread(x))) for x in steps]
        lower = [at(x, 10 ** (line(x) - spread(x))) for x in reversed(steps)]
        around = " ".join(f"{x:.1f},{y:.1f}" for x, y in [*upper, *lower])
        parts.append(f'<polygon points="{around}" fill="{svg.colour(k)}" opacity="0.12"/>')
    by_amount = {x: [y for a, y in found if a == x] for x in amounts}
    for pick, dash in ((statistics.mean, ""), (min, ' stroke-dasharray="6 4"')):
        chosen = [(x, pick(ys)) for x, ys in by_amount.items()]
        if len(chosen) > 1:
            line, _ = fit(chosen)
            (x1, y1), (x2, y2) = (at(x, 10 ** line(x)) for x in (amounts[0], amounts[-1]))
            parts.append(svg.line(x1, y1, x2, y2, svg.colour(k), 2).replace("/>", f"{dash}/>"))
    return parts + [svg.mark(k, *at(x, y)) for x, y in found]


def fit(found):
    """The least-squares line of log10 y over log10 x, and half of its 95 % band."""
    xs, ys = ([math.log10(v) for v in axis] for axis in zip(*found))
    slope, offset = statistics.linear_regression(xs, ys)
    middle = statistics.mean(xs)
    around = sum((x - middle) ** 2 for x in xs)
    free = len(xs) - 2
    rest = sum((y - slope * x - offset) ** 2 for x, y in zip(xs, ys))

    def line(x):
        return slope * math.log10(x) + offset

    def spread(x):
        error = rest / free * (1 / len(xs) + (math.log10(x) - middle) ** 2 / around)
        return STUDENT[min(free, len(STUDENT)) - 1] * error**0.5

    return line, spread
