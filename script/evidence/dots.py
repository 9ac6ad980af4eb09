"""Dots on a logarithmic axis: a line for each suite, task or point of a sweep, a mark for each policy."""

import math

from . import svg, table

LEFT, WIDTH, LINE, TOP = 250, 860, 24, 58


def draw(spec):
    """The picture as SVG text."""
    lines, columns = cells(spec)
    numbers = [n for _, row in lines for n, _ in row if n]
    low = spec.get("lowest_power", math.floor(math.log10(min(numbers))))
    high = math.ceil(math.log10(max(numbers)))
    bottom = TOP + LINE * len(lines)

    def x(number):
        share = (math.log10(max(number, 10.0**low)) - low) / (high - low)
        return LEFT + share * (WIDTH - LEFT - 30)

    parts = svg.legend(LEFT, 42, columns)
    for power in range(low, high + 1):
        at = x(10.0**power)
        parts.append(svg.line(at, TOP - 8, at, bottom))
        parts.append(svg.text(at, bottom + 18, table.decimals(10.0**power, max(0, -power)), "middle"))
    parts.append(svg.text((LEFT + WIDTH) / 2, bottom + 34, spec["axis"], "middle"))
    for i, (label, row) in enumerate(lines):
        y = TOP + LINE * i + LINE / 2
        seen = [x(n) for n, _ in row if n is not None]
        parts += [svg.text(LEFT - 14, y + 4, label, "end"), svg.line(min(seen), y, max(seen), y, width=2)]
        for k, (number, spread) in enumerate(row):
            if number is None:
                continue
            if spread:
                far = min(number + spread, 10.0**high)
                parts.append(svg.line(x(number - spread), y, x(far), y, svg.colour(k)))
            parts.append(svg.mark(k, x(number), y))
    return svg.page(WIDTH, bottom + 44, spec["title"], parts)


def cells(spec):
    """Lines of (figure, half of its interval over seeds) by row, and the columns' names."""
    lines = []
    for row in table.expand(spec):
        places = [table.address(spec, row, column) for column in spec["columns"]]
        lines.append((row["label"], [(table.value(at), table.spread(at)) for at in places]))
    return lines, [column["label"] for column in spec["columns"]]
