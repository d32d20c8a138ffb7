"""Tables as Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def markdown_table(
    head: Sequence[str], rows: Iterable[Sequence[str]], *, right: bool = False
) -> str:
    r"""A table.

    Args:
        head: Names of the columns.
        rows: Cells of each row.
        right: Whether all columns but the first are aligned right.

    Returns:
        Its lines, without a line feed at the end.

    Example:
        >>> print(markdown_table(["method", "MSE"], [["a|b", "0.2"]], right=True))
        | method | MSE |
        |---|---:|
        | a\|b | 0.2 |
    """
    others = "|---:" if right else "|---"
    lines = [_line(head), "|---" + others * (len(head) - 1) + "|", *map(_line, rows)]
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"
