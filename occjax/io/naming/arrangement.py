"""Arrangement of matched file names as a grid of views."""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from decimal import Decimal

import numpy as np

from occjax.errors import InputError, warn
from occjax.io.config import ReadingConfig
from occjax.io.limits import ReadLimits
from occjax.io.naming.patterns import NAMES, index_value, renamed


class GridWarning(UserWarning):
    """The grid of views was guessed from their number or their names, or views are missing."""


@dataclass(frozen=True)
class NamedViews:
    """The files of a folder, arranged as a grid.

    Attributes:
        grid: ``(V, U)``.
        matches: Matched file name of each view that is there, by its index ``(v, u)`` from zero.
        other_grid: ``(V, U)`` of a second grid that the names allow, row by row in the same order:
            one row of views may also be a square whose views are numbered. None if there is none.
        guessed: Whether the grid was guessed from the number of views.
        guess_note: What the warning of a guess adds to the grid: how the views are ordered, or that
            the other grid fits about as well. Empty if nothing.
        missing: File name that each view that is not there would have, by its index.
    """

    grid: tuple[int, int]
    matches: dict[tuple[int, int], re.Match[str]]
    other_grid: tuple[int, int] | None = None
    guessed: bool = False
    guess_note: str = ""
    missing: dict[tuple[int, int], str] = field(default_factory=dict)

    def regrouped(self, grid: tuple[int, int]) -> NamedViews:
        """Return the same views, row by row in the same order, as another grid."""
        ordered = [self.matches[index] for index in sorted(self.matches)]
        matches = {divmod(k, grid[1]): match for k, match in enumerate(ordered)}
        return NamedViews(grid, matches, guess_note=self.guess_note)

    def reordered(self, order: np.ndarray) -> NamedViews:
        """Return the same views in another order.

        Args:
            order: ``[V, U]`` number, counted row by row in the present grid, of the view at each
                index of the new grid.
        """
        moved = {divmod(int(k), self.grid[1]): index for index, k in np.ndenumerate(order)}
        matches = {moved[index]: match for index, match in self.matches.items()}
        missing = {moved[index]: name for index, name in self.missing.items()}
        return NamedViews(order.shape, matches, missing=missing)


def arrange_by_number(
    folder: str, matches: list[re.Match[str]], grid: tuple[int, int] | None
) -> NamedViews:
    """Arrange views that are numbered row by row.

    Numbers start at 0 or 1, or at any number if no view is missing. If views are missing at both
    ends, as in a round aperture, they are taken to be equally many. Numbers with gaps count in
    their order if they are as many as the grid has views.

    Args:
        folder: Name of the folder, for messages.
        matches: Matched file names, with the field ``i``.
        grid: ``(V, U)``; None for a square.

    Raises:
        InputError: If the number of views fits no grid.

    Warns:
        GridWarning: If views are missing.
    """
    by_number = _by_key(folder, [(index_value(match["i"]), match) for match in matches])
    numbers, present = sorted(by_number), len(by_number)
    consecutive = numbers[-1] - numbers[0] + 1 == present
    fits = present == grid[0] * grid[1] if grid else _is_square(present)
    # Only the HCI format is known to count from 0, so that its first view can be missing.
    counts_from_0 = matches[0].re is NAMES["hci"]
    starts_late = not counts_from_0 and (numbers[0] == 1 or numbers[0] > present)
    first = numbers[0] if (consecutive and fits) or starts_late else 0
    count = numbers[-1] - first + 1
    has_gaps = not _is_square(count) or 2 * present < count
    symmetric = [base for base in (0, 1) if _is_symmetric(numbers, base, grid)]
    if fits and (grid or consecutive or (has_gaps and not symmetric)):
        rows, columns = grid or (math.isqrt(present),) * 2
        # The benchmarks have 9x9 views.
        certain = grid is not None or (consecutive and present in (1, 81))
        gaps = "" if consecutive else " in the order of their numbers, which have gaps"
        ordered = enumerate(by_number[number] for number in numbers)
        return NamedViews(
            (rows, columns),
            {divmod(k, columns): match for k, match in ordered},
            other_grid=None if certain else (1, present),
            guessed=not certain,
            guess_note="" if certain else gaps,
        )
    if symmetric:
        first = symmetric[0]
        count = numbers[0] + numbers[-1] + 1 - 2 * first
    elif grid is None and has_gaps:
        raise InputError(
            f"{folder}: {present} views up to {by_number[numbers[-1]].string!r} do not form a "
            "square grid; pass the grid with the missing views (--grid V U), or add them"
        )
    rows, columns = grid or (math.isqrt(count),) * 2
    _check_present(folder, present, (rows, columns))
    if count > rows * columns:
        raise InputError(
            f"{folder}: {by_number[numbers[-1]].string!r} is beyond the {rows}x{columns} grid; "
            f"pass a grid of {present} views (--grid V U) or add the missing ones"
        )
    return _incomplete(
        folder,
        NamedViews(
            (rows, columns), {divmod(n - first, columns): match for n, match in by_number.items()}
        ),
        lambda v, u: {"i": first + v * columns + u},
    )


def arrange_by_row_and_column(
    folder: str, matches: list[re.Match[str]], grid: tuple[int, int] | None
) -> NamedViews:
    """Arrange views that are named by row and column, starting from any row and column.

    If the names show one row or one column, a given grid of as many views replaces it: the constant
    index is then a frame number. Rows or columns that a given grid has in addition to the names are
    missing; there must be equally many on both sides.

    Args:
        folder: Name of the folder, for messages.
        matches: Matched file names, with the fields ``v`` and ``u``.
        grid: ``(V, U)``; None to take it from the names.

    Raises:
        InputError: If the names show another grid or none.

    Warns:
        GridWarning: If views are missing.
    """
    indices = [(index_value(match["v"]), index_value(match["u"])) for match in matches]
    by_index = _by_key(folder, list(zip(indices, matches, strict=True)))
    rows, columns = (_without_gaps(sorted(set(values))) for values in zip(*by_index, strict=True))
    found = (_count(rows), _count(columns))
    one_line = 1 in found and math.prod(found) == len(by_index)
    shape = grid or found
    if one_line and shape != found and math.prod(shape) == len(by_index):
        return NamedViews(found, by_index).regrouped(shape)
    margins = (shape[0] - found[0], shape[1] - found[1])
    if min(margins) < 0:
        raise InputError(
            f"{folder}: the names show {found[0]}x{found[1]} views, not {shape[0]}x{shape[1]}; "
            "leave out grid, or move the other views to another folder"
        )
    if any(margin % 2 for margin in margins):
        raise InputError(
            f"{folder}: the names show {found[0]}x{found[1]} views; on which side of the "
            f"{margins} missing rows and columns they are is unknown; leave out grid"
        )
    _check_present(folder, len(by_index), shape)
    for axis, name in enumerate(("rows", "columns")):
        filled = len({index[axis] for index in by_index})
        if shape[axis] > 2 * filled:
            raise InputError(
                f"{folder}: the names show {shape[0]}x{shape[1]} views, but most {name} have none; "
                "name one grid only, or pass pattern (--pattern)"
            )
    rows, columns = (
        _extended(numbers, margin // 2)
        for numbers, margin in zip((rows, columns), margins, strict=True)
    )
    placed = {(rows.index(v), columns.index(u)): match for (v, u), match in by_index.items()}
    named = NamedViews((len(rows), len(columns)), placed)
    if len(placed) == math.prod(named.grid):
        side = math.isqrt(len(placed))
        ambiguous = 1 in found and side > 1 and side**2 == len(placed) and grid is None
        return dataclasses.replace(named, other_grid=(side, side) if ambiguous else None)
    return _incomplete(folder, named, lambda v, u: {"v": rows[v], "u": columns[u]})


def _incomplete(
    folder: str, named: NamedViews, fields: Callable[[int, int], dict[str, int]]
) -> NamedViews:
    """Warn of the missing views of a grid, and add their names.

    Args:
        folder: Name of the folder.
        named: Views that are there.
        fields: Function that returns the indices in the file name of a view ``(v, u)``.
    """
    sample = next(iter(named.matches.values()))
    missing = {
        index: renamed(sample, fields(*index))
        for index in np.ndindex(*named.grid)
        if index not in named.matches
    }
    if not missing:
        return named
    verb = "is" if len(missing) == 1 else "are"
    warn(
        f"{folder}: {len(missing)} of the {named.grid[0]}x{named.grid[1]} views {verb} missing "
        f"({first_few(list(missing.values()))}) and not used",
        GridWarning,
    )
    return dataclasses.replace(named, missing=missing)


def first_few(names: list[str]) -> str:
    """Return the first names of a list, for messages."""
    return ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")


def _check_present(folder: str, present: int, grid: tuple[int, int]) -> None:
    """Refuse a grid of many more views than there are files."""
    if math.prod(grid) > ReadLimits.current().views_per_file * present:
        rows, columns = (n if n < 1e9 else f"{Decimal(n):.3g}" for n in grid)
        raise InputError(
            f"{folder}: has {present} of the {rows}x{columns} views; correct the grid (--grid V U, "
            "num_cams_y and num_cams_x in parameters.cfg) or the names of the files"
        )


def _without_gaps(numbers: list[int]) -> range:
    """Return all row or column numbers: a constant step is kept, gaps are filled."""
    steps = {after - before for before, after in itertools.pairwise(numbers)}
    return range(numbers[0], numbers[-1] + 1, steps.pop() if len(steps) == 1 else 1)


def _count(numbers: range) -> int:
    """Return the length of a range of any numbers; ``len`` fails for large ones."""
    return (numbers[-1] - numbers[0]) // numbers.step + 1


def _extended(numbers: range, margin: int) -> range:
    """Return row or column numbers with as many more on both sides."""
    step = numbers.step
    return range(numbers[0] - margin * step, numbers[-1] + (margin + 1) * step, step)


def _is_square(count: int) -> bool:
    return math.isqrt(count) ** 2 == count


def _is_symmetric(numbers: list[int], base: int, grid: tuple[int, int] | None) -> bool:
    """Return whether as many numbers of a grid are missing at the start as at the end.

    Args:
        numbers: Numbers of the views, ascending.
        base: Number of the first view of the grid.
        grid: ``(V, U)``; None for any square that the views fill like a round aperture.
    """
    count = numbers[0] + numbers[-1] + 1 - 2 * base
    if numbers[0] <= base:
        return False
    if grid is not None:
        return count == math.prod(grid)
    return _is_square(count) and len(numbers) >= ReadingConfig().min_round_fraction * count


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
