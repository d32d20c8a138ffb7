"""Tables of scores as Markdown, LaTeX and a picture, the best and second best marked.

A table has a row for each method and a column for each scene. Numbers are shown with at most four
digits, as the paper prints them, and ranked as they are shown: equal numbers share a rank.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from experiments.markdown import markdown_table
from occjax.viz.canvas import MARGIN, TEXT, Canvas

DASH = "–"  # noqa: RUF001
"""What is not known."""


@dataclass(frozen=True)
class Table:
    """Scores of several methods by one measure, smaller being better.

    Attributes:
        title: Name of the measure.
        columns: Names of scenes and averages.
        rows: By method, a number for each column, or None where there is none.
        printed: By method and column, another number to show in brackets.
    """

    title: str
    columns: tuple[str, ...]
    rows: Mapping[str, Sequence[float | None]]
    printed: Mapping[tuple[str, str], float]


def shown(value: float) -> str:
    """A number with four digits and at most three decimals.

    Example:
        >>> shown(0.0042), shown(12.4), shown(100.0)
        ('0.004', '12.40', '100.0')
    """
    return f"{value:.{_decimals(value)}f}"


def rounding(value: float) -> float:
    """How far a number that was printed like that can be from what it stands for.

    Example:
        >>> rounding(0.004), rounding(12.4)
        (0.0005, 0.005)
    """
    return 0.5 / 10 ** _decimals(value)


def _decimals(value: float) -> int:
    return next(n for n, limit in ((3, 9.9995), (2, 99.995), (1, np.inf)) if value < limit)


def ranks(values: Sequence[float | None]) -> tuple[int | None, ...]:
    """Places in a column: 1 is the best; numbers that look equal share a place.

    Example:
        >>> ranks([0.3, 0.2, None, 0.2])
        (2, 1, None, 1)
    """
    numbers = [None if value is None else float(shown(value)) for value in values]
    order = sorted({number for number in numbers if number is not None})
    return tuple(None if number is None else 1 + order.index(number) for number in numbers)


def markdown(tables: Sequence[Table], notes: Sequence[str]) -> str:
    """All tables, the best **bold** and the second best underlined, and notes below them."""
    blocks = []
    for table in tables:
        rows = [[name, *cells] for name, cells in _cells(table, "**{}**", "<u>{}</u>").items()]
        blocks.append(markdown_table([table.title, *table.columns], rows, right=True))
    return "\n\n".join([*blocks, *notes])


def latex(tables: Sequence[Table], notes: Sequence[str]) -> str:
    """The same as LaTeX tabulars; needs the package booktabs."""
    blocks = []
    for table in tables:
        lines = [
            rf"\begin{{tabular}}{{l{'r' * len(table.columns)}}}",
            r"\toprule",
            " & ".join(map(_escaped, [table.title, *table.columns])) + r" \\",
            r"\midrule",
        ]
        for method, cells in _cells(table, r"\textbf{{{}}}", r"\underline{{{}}}").items():
            words = [_escaped(method), *(cell.replace(DASH, "--") for cell in cells)]
            lines.append(" & ".join(words) + r" \\")
        lines += [r"\bottomrule", r"\end{tabular}"]
        blocks.append("\n".join(lines))
    return "\n\n".join([*blocks, *(rf"\noindent {_escaped(note)}" for note in notes)])


CELL_WIDTH, CELL_HEIGHT, GAP, NOTE_HEIGHT = 92, 22, 18, 20
LETTER = 7
"""Pixels in the width of a letter, at most, on average."""


def picture(tables: Sequence[Table], notes: Sequence[str]) -> Figure:
    """The same as a picture: the darker a cell, the farther behind the best of its column."""
    names = LETTER * max(15, *(len(method) for table in tables for method in table.rows))
    width = 2 * MARGIN + names + CELL_WIDTH * max(len(table.columns) for table in tables)
    heights = [(1 + len(table.rows)) * CELL_HEIGHT + GAP for table in tables]
    legend = "Bold: best. Underlined: second best. Darker: farther behind the best of the column."
    lines = [line for note in (legend, *notes) for line in wrap(note, width // LETTER)]
    canvas = Canvas(width, 2 * MARGIN + sum(heights) + NOTE_HEIGHT * len(lines))
    top = MARGIN
    for table, height in zip(tables, heights, strict=True):
        _draw(canvas, table, top, names)
        top += height
    for number, note in enumerate(lines):
        y = 1.0 - (top + (number + 0.5) * NOTE_HEIGHT) / canvas.size[1]
        canvas.figure.text(
            MARGIN / width, y, note, fontsize=8.5, va="center", color=TEXT, parse_math=False
        )
    return canvas.figure


def _draw(canvas: Canvas, table: Table, top: int, names: int) -> None:
    """One table, names in the first pixels; a unit of its axes is a cell."""
    rows, columns = len(table.rows), len(table.columns)
    values = np.array([[np.nan if v is None else v for v in row] for row in table.rows.values()])
    axes = canvas.axes(MARGIN + names, top, columns * CELL_WIDTH, (1 + rows) * CELL_HEIGHT)
    axes.set(xlim=(0, columns), ylim=(1 + rows, 0))
    axes.set_axis_off()
    # Five times the best is as dark as it gets. A best of zero has no multiples.
    best = np.fmin.reduce(values, axis=0)
    behind = np.log(np.maximum(values, 1e-3) / np.maximum(best, 1e-3)) / np.log(5.0)
    colours = colormaps["YlGnBu"](0.5 * np.clip(np.ma.masked_invalid(behind), 0.0, 1.0))
    colours[np.isnan(values)] = 1.0
    axes.imshow(colours, extent=(0, columns, 1 + rows, 1), aspect="auto", interpolation="nearest")
    name: dict[str, Any] = {"va": "center", "fontsize": 8.5, "color": TEXT, "parse_math": False}
    indent = -names / CELL_WIDTH
    axes.text(indent, 0.5, table.title, weight="bold", **name)
    for column, word in enumerate(table.columns):
        axes.text(column + 0.5, 0.5, word, ha="center", **name)
    places = np.array([ranks(row) for row in zip(*table.rows.values(), strict=True)]).T
    plain = _cells(table, "{}", "{}")
    for row, (method, cells) in enumerate(plain.items()):
        axes.text(indent, row + 1.5, method, **name)
        for column, cell in enumerate(cells):
            place = places[row, column]
            weight = "bold" if place == 1 else "normal"
            axes.text(column + 0.5, row + 1.5, cell, ha="center", weight=weight, **name)
            if place == 2:
                axes.plot([column + 0.3, column + 0.7], [row + 1.88] * 2, color=TEXT, lw=0.9)


def _cells(table: Table, best: str, second: str) -> dict[str, list[str]]:
    """What is in the cells of each row, marked by two formats."""
    places = [ranks(column) for column in zip(*table.rows.values(), strict=True)]
    cells: dict[str, list[str]] = {}
    for row, (method, values) in enumerate(table.rows.items()):
        cells[method] = []
        for column, value in enumerate(values):
            text = DASH if value is None else shown(value)
            text = {1: best, 2: second}.get(places[column][row] or 0, "{}").format(text)
            other = table.printed.get((method, table.columns[column]))
            cells[method].append(text if other is None else f"{text} ({shown(other)})")
    return cells


def _escaped(text: str) -> str:
    r"""Text without the characters that mean something to LaTeX.

    Example:
        >>> _escaped("light_2 & 3 %")
        'light\\_2 \\& 3 \\%'
    """
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    return "".join(special.get(c, f"\\{c}" if c in "_&%$#{}" else c) for c in text)
