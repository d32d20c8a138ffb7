"""Assignment of the files of a folder to views, by their names."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from occjax.errors import InputError
from occjax.io.images import IMAGE_SUFFIXES, UNSUPPORTED_SUFFIXES

FolderLayout = Literal["hci", "lytro", "urbanlf", "stanford"]

_SUFFIX = r"\.(?:" + "|".join(suffix[1:] for suffix in IMAGE_SUFFIXES) + r")"
_NUMBER = r"-?\d+(?:\.\d+)?"

NAMES: Mapping[FolderLayout, re.Pattern[str]] = {
    "hci": re.compile(rf"input_Cam(?P<i>\d+){_SUFFIX}", re.IGNORECASE),
    "lytro": re.compile(
        rf"(?!out_\d+_\d+_-?\d)(?P<scene>.+)_(?P<v>\d{{1,3}})_(?P<u>\d{{1,3}}){_SUFFIX}",
        re.IGNORECASE,
    ),
    "urbanlf": re.compile(rf"(?P<v>\d{{1,2}})_(?P<u>\d{{1,2}}){_SUFFIX}", re.IGNORECASE),
    "stanford": re.compile(
        rf"out_(?P<v>\d+)_(?P<u>\d+)_(?P<y>{_NUMBER})_(?P<x>{_NUMBER})(?P<tail>_?){_SUFFIX}",
        re.IGNORECASE,
    ),
}
"""File names of the known layouts: ``v`` and ``u`` (row and column) or ``i`` (row by row)."""

EXAMPLES: Mapping[FolderLayout, str] = {
    "hci": "input_Cam000.png",
    "lytro": "NAME_01_01.png",
    "urbanlf": "1_1.png",
    "stanford": "out_00_00_-780.13_-3355.33_.png",
}
"""A file name of each layout, for messages."""

BENCHMARK_VIEWS = 81
"""Number of views of the benchmarks, which is taken as a 9x9 grid without a warning."""


class GridWarning(UserWarning):
    """The grid of views was guessed from their number."""


@dataclass(frozen=True)
class NamedViews:
    """The files of a folder, arranged as a grid.

    Attributes:
        grid: ``(V, U)``.
        matches: Matched file name of each view, by its index ``(v, u)`` from zero.
    """

    grid: tuple[int, int]
    matches: dict[tuple[int, int], re.Match[str]]


def find_views(
    folder: str,
    names: Iterable[str],
    *,
    layout: FolderLayout | None = None,
    pattern: str | None = None,
    grid: tuple[int, int] | None = None,
) -> tuple[FolderLayout | None, NamedViews]:
    """Assign the files of a folder to views.

    Args:
        folder: Name of the folder, for messages.
        names: Names of the files in it.
        layout: Layout of the file names; None to detect it.
        pattern: File name pattern that replaces a known layout.
        grid: ``(V, U)``; None to take it from the names. It is required if the names have one
            running number and the views do not form a square.

    Returns:
        The layout (None for a pattern) and the views.

    Raises:
        InputError: If no layout or more than one fits, or views are missing.

    Warns:
        GridWarning: If the grid is guessed from the number of views.
    """
    names = sorted(names)
    if pattern is not None:
        matches, expected = _matching(names, pattern_to_regex(pattern)), f"matches {pattern!r}"
    else:
        layout = layout or _detect_layout(folder, names)
        matches = _matching(names, NAMES[layout])
        expected = f"is named like {EXAMPLES[layout]!r}"
    if not matches:
        raise InputError(f"{folder}: no file {expected}{_found(names)}")
    scenes = {match.groupdict().get("scene") for match in matches}
    if len(scenes) > 1:
        raise InputError(
            f"{folder}: has views of several scenes ({_first_few(sorted(map(str, scenes)))}); "
            "move each to a folder of its own"
        )
    arrange = _by_number if "i" in matches[0].groupdict() else _by_row_and_column
    return layout, arrange(folder, matches, grid)


def pattern_to_regex(pattern: str) -> re.Pattern[str]:
    """Turn a file name pattern with ``{v}`` and ``{u}``, or ``{i}``, into a regular expression.

    Args:
        pattern: For instance ``"view_{v}_{u}.png"``.

    Raises:
        InputError: If the pattern does not have exactly those fields.

    Example:
        >>> pattern_to_regex("view_{v}-{u}.png").fullmatch("view_3-12.png").groupdict()
        {'v': '3', 'u': '12'}
    """
    fields = re.findall(r"\{(.*?)\}", pattern)
    if sorted(fields) not in (["i"], ["u", "v"]):
        raise InputError(
            f"pattern {pattern!r} must contain {{v}} and {{u}} (row and column) or {{i}} (number), "
            "each once"
        )
    parts = re.split(r"\{[vui]\}", pattern)
    groups = [rf"(?P<{field}>\d+)" for field in fields] + [""]
    text = "".join(re.escape(part) + group for part, group in zip(parts, groups, strict=True))
    return re.compile(text)


def _matching(names: list[str], regex: re.Pattern[str]) -> list[re.Match[str]]:
    """Return the matches of the names that match as a whole."""
    return [match for match in map(regex.fullmatch, names) if match]


def _detect_layout(folder: str, names: list[str]) -> FolderLayout:
    """Return the only layout that fits names of the folder."""
    fitting = [layout for layout, regex in NAMES.items() if _matching(names, regex)]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        raise InputError(
            f"{folder}: has files of several layouts ({', '.join(fitting)}); "
            f"pass layout (--layout {fitting[0]}, or another of them)"
        )
    images = [name for name in names if name.lower().endswith(IMAGE_SUFFIXES)]
    unsupported = [name for name in names if name.lower().endswith(UNSUPPORTED_SUFFIXES)]
    if images:
        raise InputError(
            f"{folder}: does not name its views in a known way{_found(images)}; "
            "pass pattern (--pattern 'view_{v}_{u}.png', or 'view_{i}.png')"
        )
    if unsupported:
        raise InputError(
            f"{folder}: has images of a kind that is not read ({_first_few(unsupported)}); "
            "convert them to PNG"
        )
    raise InputError(f"{folder}: has no images{_found(names)}")


def _by_number(
    folder: str, matches: list[re.Match[str]], grid: tuple[int, int] | None
) -> NamedViews:
    """Arrange views that are numbered row by row.

    Numbers start at 0 or 1, or at any number if no view is missing.
    """
    by_number = _by_key(folder, [(int(match["i"]), match) for match in matches])
    lowest, highest = min(by_number), max(by_number)
    expected = math.isqrt(len(by_number)) ** 2 if grid is None else grid[0] * grid[1]
    complete = highest - lowest + 1 == len(by_number) == expected
    first = lowest if complete or lowest == 1 else 0
    count = highest - first + 1
    if grid is None:
        side = math.isqrt(count)
        if side * side != count:
            raise InputError(
                f"{folder}: {count} views up to {by_number[highest].string!r} form no square; "
                "add the missing ones or pass grid (--grid V U)"
            )
        grid = (side, side)
        if complete and count not in (1, BENCHMARK_VIEWS):
            warnings.warn(
                f"{folder}: {count} views taken as {side}x{side}; "
                "pass grid (--grid V U) if they are not",
                GridWarning,
                stacklevel=2,
            )
    rows, columns = grid
    missing = [n for n in range(first, first + rows * columns) if n not in by_number]
    _refuse_missing(folder, grid, [_renamed(matches[0], {"i": n}) for n in missing])
    if count > rows * columns:
        raise InputError(
            f"{folder}: {by_number[highest].string!r} is beyond the {rows}x{columns} grid; "
            "pass the right grid (--grid V U)"
        )
    return NamedViews(grid, {divmod(n - first, columns): match for n, match in by_number.items()})


def _by_row_and_column(
    folder: str, matches: list[re.Match[str]], grid: tuple[int, int] | None
) -> NamedViews:
    """Arrange views that are named by row and column, starting from any row and column."""
    by_index = _by_key(folder, [((int(match["v"]), int(match["u"])), match) for match in matches])
    rows, columns = zip(*by_index, strict=True)
    first_v, first_u = min(rows), min(columns)  # 0, 1, or any number in a crop of a larger grid
    found = (max(rows) - first_v + 1, max(columns) - first_u + 1)
    grid = grid or found
    if found[0] > grid[0] or found[1] > grid[1]:
        raise InputError(
            f"{folder}: has {found[0]}x{found[1]} views, not {grid[0]}x{grid[1]}; "
            f"pass grid (--grid {found[0]} {found[1]})"
        )
    expected = [(first_v + v, first_u + u) for v in range(grid[0]) for u in range(grid[1])]
    missing = [index for index in expected if index not in by_index]
    _refuse_missing(folder, grid, [_renamed(matches[0], {"v": v, "u": u}) for v, u in missing])
    return NamedViews(grid, {(v - first_v, u - first_u): m for (v, u), m in by_index.items()})


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


def _renamed(sample: re.Match[str], numbers: dict[str, int]) -> str:
    """Return the file name that another view would have."""
    name, end = sample.string, 0
    text = ""
    for field, number in sorted(numbers.items(), key=lambda item: sample.start(item[0])):
        text += name[end : sample.start(field)] + str(number).zfill(len(sample[field]))
        end = sample.end(field)
    has_position = "y" in sample.groupdict()
    return text + ("_..." if has_position else name[end:])


def _refuse_missing(folder: str, grid: tuple[int, int], missing: list[str]) -> None:
    """Raise an error that names the missing views."""
    if missing:
        are, them = ("is", "it") if len(missing) == 1 else ("are", "them")
        raise InputError(
            f"{folder}: {len(missing)} of the {grid[0]}x{grid[1]} views {are} missing "
            f"({_first_few(missing)}); add {them} or pass the right grid (--grid V U)"
        )


def _first_few(names: list[str]) -> str:
    return ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")


def _found(names: list[str]) -> str:
    """Describe the files that a folder contains instead of the expected ones."""
    return f" (it has: {_first_few(names)})" if names else " (it is empty)"
