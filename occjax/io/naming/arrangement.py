"""Arrangement of matched file names as a grid of views."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from occjax.errors import InputError
from occjax.io.naming.patterns import index_value, renamed

BENCHMARK_VIEWS = 81
"""Number of views of the benchmarks, which is taken as a 9x9 grid without a warning."""

MIN_COMPLETE_FRACTION = 0.5
"""Smallest fraction of the numbers from which gaps count as missing views."""


class GridWarning(UserWarning):
    """The grid of views was guessed from their number or their names."""


@dataclass(frozen=True)
class NamedViews:
    """The files of a folder, arranged as a grid.

    Attributes:
        grid: ``(V, U)``.
        matches: Matched file name of each view, by its index ``(v, u)`` from zero.
        other_grid: ``(V, U)`` of a second reading of the names, row by row in the same order: one
            row of views may also be a square whose views are numbered. None if there is only one.
        guess: If the grid was guessed from the number of views, how they are ordered; else None.
    """

    grid: tuple[int, int]
    matches: dict[tuple[int, int], re.Match[str]]
    other_grid: tuple[int, int] | None = None
    guess: str | None = None

    def regrouped(self, grid: tuple[int, int]) -> NamedViews:
        """Return the same views, row by row in the same order, as another grid."""
        ordered = [self.matches[index] for index in sorted(self.matches)]
        matches = {divmod(k, grid[1]): match for k, match in enumerate(ordered)}
        return NamedViews(grid, matches, guess=self.guess or "")


def arrange_by_number(
    folder: str, matches: list[re.Match[str]], grid: tuple[int, int] | None
) -> NamedViews:
    """Arrange views that are numbered row by row.

    Numbers start at 0 or 1, or at any number if no view is missing. Numbers with gaps count in
    their order if they are as many as the grid has views.

    Args:
        folder: Name of the folder, for messages.
        matches: Matched file names, with the field ``i``.
        grid: ``(V, U)``; None for a square.

    Raises:
        InputError: If views are missing or there are too many.
    """
    by_number = _by_key(folder, [(index_value(match["i"]), match) for match in matches])
    numbers, present = sorted(by_number), len(by_number)
    consecutive = numbers[-1] - numbers[0] + 1 == present
    fits = present == grid[0] * grid[1] if grid else _is_square(present)
    starts_late = numbers[0] == 1 or numbers[0] > present
    first = numbers[0] if (consecutive and fits) or starts_late else 0
    count = numbers[-1] - first + 1
    has_gaps = not _is_square(count) or present < MIN_COMPLETE_FRACTION * count
    if fits and (grid or consecutive or has_gaps):
        rows, columns = grid or (math.isqrt(present),) * 2
        certain = grid is not None or (consecutive and present in (1, BENCHMARK_VIEWS))
        gaps = "" if consecutive else " in the order of their numbers, which have gaps"
        ordered = enumerate(by_number[number] for number in numbers)
        return NamedViews(
            (rows, columns),
            {divmod(k, columns): match for k, match in ordered},
            other_grid=None if certain else (1, present),
            guess=None if certain else gaps,
        )
    if grid is None and has_gaps:
        raise InputError(
            f"{folder}: {present} views up to {by_number[numbers[-1]].string!r} do not form a "
            "square grid; add the missing ones or pass grid (--grid V U)"
        )
    rows, columns = grid or (math.isqrt(count),) * 2
    if count > rows * columns:
        raise InputError(
            f"{folder}: {by_number[numbers[-1]].string!r} is beyond the {rows}x{columns} grid; "
            f"pass a grid of {present} views (--grid V U) or add the missing ones"
        )
    missing = [n for n in range(first, first + rows * columns) if n not in by_number]
    refuse_missing(folder, (rows, columns), [renamed(matches[0], {"i": n}) for n in missing])
    return NamedViews(
        (rows, columns), {divmod(n - first, columns): match for n, match in by_number.items()}
    )


def arrange_by_row_and_column(
    folder: str, matches: list[re.Match[str]], grid: tuple[int, int] | None
) -> NamedViews:
    """Arrange views that are named by row and column, starting from any row and column.

    A given grid that has as many views as the names, which show one row or one column, is obeyed:
    the other index is then a frame number.

    Args:
        folder: Name of the folder, for messages.
        matches: Matched file names, with the fields ``v`` and ``u``.
        grid: ``(V, U)``; None to take it from the names.

    Raises:
        InputError: If views are missing or the names show another grid.
    """
    indices = [(index_value(match["v"]), index_value(match["u"])) for match in matches]
    by_index = _by_key(folder, list(zip(indices, matches, strict=True)))
    rows, columns = (_places(sorted(set(values))) for values in zip(*by_index, strict=True))
    found = (len(rows), len(columns))
    missing = [index for v in rows for u in columns if (index := (v, u)) not in by_index]
    if grid is None or tuple(grid) == found:
        refuse_missing(folder, found, [renamed(matches[0], {"v": v, "u": u}) for v, u in missing])
        side = math.isqrt(len(by_index))
        ambiguous = 1 in found and side > 1 and side**2 == len(by_index) and grid is None
        placed = {(rows.index(v), columns.index(u)): match for (v, u), match in by_index.items()}
        return NamedViews(found, placed, (side, side) if ambiguous else None)
    if 1 in found and not missing and math.prod(grid) == len(by_index):
        return NamedViews(found, by_index).regrouped(grid)
    if found[0] > grid[0] or found[1] > grid[1]:
        raise InputError(
            f"{folder}: the names show {found[0]}x{found[1]} views, not {grid[0]}x{grid[1]}; "
            "leave out grid, or move the other views to another folder"
        )
    expected = [(rows[0] + v, columns[0] + u) for v in range(grid[0]) for u in range(grid[1])]
    absent = [index for index in expected if index not in by_index]
    refuse_missing(folder, grid, [renamed(matches[0], {"v": v, "u": u}) for v, u in absent])
    raise InputError(f"{folder}: the names do not form a {grid[0]}x{grid[1]} grid; leave out grid")


def refuse_missing(folder: str, grid: tuple[int, int], missing: list[str]) -> None:
    """Raise an error that names the missing views.

    Args:
        folder: Name of the folder.
        grid: ``(V, U)`` with the missing views.
        missing: File names that they would have; no error if empty.
    """
    if missing:
        are, them = ("is", "it") if len(missing) == 1 else ("are", "them")
        raise InputError(
            f"{folder}: {len(missing)} of the {grid[0]}x{grid[1]} views {are} missing "
            f"({first_few(missing)}); add {them}, or move a complete smaller grid to another folder"
        )


def first_few(names: list[str]) -> str:
    """Return the first names of a list, for messages."""
    return ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")


def _places(indices: list[int]) -> list[int]:
    """Return all row or column numbers: a constant step is kept, gaps are filled."""
    step = indices[1] - indices[0] if len(indices) > 1 else 1
    regular = list(range(indices[0], indices[-1] + 1, step))
    return regular if regular == indices else list(range(indices[0], indices[-1] + 1))


def _is_square(count: int) -> bool:
    return math.isqrt(count) ** 2 == count


def _by_key(folder: str, keyed: list[tuple]) -> dict:
    """Return the matches by key; two files of one view are refused."""
    by_key: dict = {}
    for key, match in keyed:
        if key in by_key:
            raise InputError(
                f"{folder}: {by_key[key].string!r} and {match.string!r} are the same view; "
                "remove one"
            )
        by_key[key] = match
    return by_key
