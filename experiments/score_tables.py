"""Tables of scores as Markdown and LaTeX, with the best and the second best marked.

A table has a row for each method and a column for each scene. Numbers have at most four digits, as
in the paper, and are ranked as printed: equal printed numbers share a rank.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.markdown import markdown_table

DASH = "–"  # noqa: RUF001
"""Text of an unknown score."""


@dataclass(frozen=True)
class Table:
    """Scores of several methods by one measure; smaller is better.

    Attributes:
        title: Name of the measure.
        columns: Names of scenes and averages.
        rows: By method, a score for each column; None where it is unknown.
        printed: By method and column, a second number to print in brackets.
    """

    title: str
    columns: tuple[str, ...]
    rows: Mapping[str, Sequence[float | None]]
    printed: Mapping[tuple[str, str], float]


def format_score(value: float) -> str:
    """Format a number with four digits and at most three decimals.

    Example:
        >>> format_score(0.0042), format_score(12.4), format_score(100.0)
        ('0.004', '12.40', '100.0')
    """
    return f"{value:.{_decimals(value)}f}"


def rounding_error(value: float) -> float:
    """Return the maximum rounding error of a number printed by :func:`format_score`.

    Example:
        >>> rounding_error(0.004), rounding_error(12.4)
        (0.0005, 0.005)
    """
    return 0.5 / 10 ** _decimals(value)


def _decimals(value: float) -> int:
    return next(n for n, limit in ((3, 9.9995), (2, 99.995), (1, np.inf)) if value < limit)


def ranks(values: Sequence[float | None]) -> tuple[int | None, ...]:
    """Return the rank of each score in a column; the best is 1, equal printed numbers share a rank.

    Example:
        >>> ranks([0.3, 0.2, None, 0.2])
        (2, 1, None, 1)
    """
    numbers = [None if value is None else float(format_score(value)) for value in values]
    order = sorted({number for number in numbers if number is not None})
    return tuple(None if number is None else 1 + order.index(number) for number in numbers)


def markdown(tables: Sequence[Table], notes: Sequence[str]) -> str:
    """Return tables and notes as Markdown; the best is bold, the second best underlined."""
    blocks = []
    for table in tables:
        rows = [[name, *cells] for name, cells in _cells(table, "**{}**", "<u>{}</u>").items()]
        blocks.append(markdown_table([table.title, *table.columns], rows, right=True))
    return "\n\n".join([*blocks, *notes])


def latex(tables: Sequence[Table], notes: Sequence[str]) -> str:
    """Return tables and notes as LaTeX tabulars, which need the package booktabs."""
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


def _cells(table: Table, best: str, second: str) -> dict[str, list[str]]:
    """Return the cells of each row, with the best and the second best formatted."""
    places = [ranks(column) for column in zip(*table.rows.values(), strict=True)]
    cells: dict[str, list[str]] = {}
    for row, (method, values) in enumerate(table.rows.items()):
        cells[method] = []
        for column, value in enumerate(values):
            text = DASH if value is None else format_score(value)
            text = {1: best, 2: second}.get(places[column][row] or 0, "{}").format(text)
            other = table.printed.get((method, table.columns[column]))
            cells[method].append(text if other is None else f"{text} ({format_score(other)})")
    return cells


def _escaped(text: str) -> str:
    r"""Return the text with the special characters of LaTeX escaped.

    Example:
        >>> _escaped("light_2 & 3 %")
        'light\\_2 \\& 3 \\%'
    """
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    return "".join(special.get(c, f"\\{c}" if c in "_&%$#{}" else c) for c in text)
