"""Markdown tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from occjax.io.atomic import atomic_path


def markdown_table(
    head: Sequence[str], rows: Iterable[Sequence[str]], *, right: bool = False
) -> str:
    r"""Return a table.

    Args:
        head: Names of the columns.
        rows: Cells of each row.
        right: Align all columns except the first to the right.

    Returns:
        Lines of the table, without a newline at the end.

    Example:
        >>> print(markdown_table(["method", "MSE"], [["a|b", "0.2"]], right=True))
        | method | MSE |
        |---|---:|
        | a\|b | 0.2 |
    """
    others = "|---:" if right else "|---"
    lines = [_line(head), "|---" + others * (len(head) - 1) + "|", *map(_line, rows)]
    return "\n".join(lines)


def write_text(path: Path, text: str) -> None:
    """Write a text and a newline to a file, atomically."""
    with atomic_path(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def print_text(text: str, path: Path | None) -> None:
    """Print a text, and write it to a file if one is given."""
    print(text)
    if path is not None:
        write_text(path, text)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"
