"""Which file of a folder is which view, by its name."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

from occjax.errors import InputError
from occjax.io.images import IMAGE_SUFFIXES, OTHER_SUFFIXES

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
"""A name of each layout, for messages."""

USUAL_COUNT = 81
"""Number of views of the benchmarks, which are 9x9 without saying so."""


class GridWarning(UserWarning):
    """The grid of views is a guess from their number."""


@dataclass(frozen=True)
class NamedViews:
    """The files of a folder laid out as a grid.

    Attributes:
        grid: ``(V, U)``.
        matches: The file name of each view, matched, by its place ``(v, u)`` from zero.
    """

    grid: tuple[int, int]
    matches: dict[tuple[int, int], re.Match[str]]


def pattern_to_regex(pattern: str) -> re.Pattern[str]:
    """A file name pattern with ``{v}`` and ``{u}``, or ``{i}``, as a regular expression.

    Raises:
        InputError: If the pattern does not have exactly those.

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


def find_views(
    folder: str,
    names: Iterable[str],
    *,
    layout: FolderLayout | None = None,
    pattern: str | None = None,
    grid: tuple[int, int] | None = None,
) -> tuple[FolderLayout | None, NamedViews]:
    """Find out which file is which view.

    Args:
        folder: Name of the folder, for messages.
        names: Names of the files in it.
        layout: The layout; None to find out.
        pattern: File name pattern in place of a known layout.
        grid: ``(V, U)``; None to take it from the names. Names with one running number need it
            where the views do not form a square.

    Returns:
        The layout (None for a pattern) and the views.

    Raises:
        InputError: If no layout or more than one fits, or views are missing.

    Warns:
        GridWarning: If the grid is guessed from the number of views.
    """
    names = sorted(names)
    if pattern is not None:
        matches = _matching(names, pattern_to_regex(pattern))
        if not matches:
            raise InputError(f"{folder}: no file matches {pattern!r}{_what_is_there(names)}")
    else:
        layout = layout or _only_layout(folder, names)
        matches = _matching(names, NAMES[layout])
        if not matches:
            raise InputError(
                f"{folder}: no file is named like {EXAMPLES[layout]!r}{_what_is_there(names)}"
            )
    scenes = {match.groupdict().get("scene") for match in matches}
    if len(scenes) > 1:
        raise InputError(
            f"{folder}: has views of several scenes ({_some(sorted(map(str, scenes)))}); "
            "move each to a folder of its own"
        )
    by_number = "i" in matches[0].groupdict()
    views = _numbered(folder, matches, grid) if by_number else _placed(folder, matches, grid)
    return layout, views


def _matching(names: list[str], regex: re.Pattern[str]) -> list[re.Match[str]]:
    """The names that match as a whole."""
    return [match for match in map(regex.fullmatch, names) if match]


def _only_layout(folder: str, names: list[str]) -> FolderLayout:
    """The one layout that fits names of the folder."""
    fitting = [layout for layout, regex in NAMES.items() if _matching(names, regex)]
    if len(fitting) > 1:
        raise InputError(
            f"{folder}: has files of several layouts ({', '.join(fitting)}); "
            f"pass layout (--layout {fitting[0]}, or another of them)"
        )
    if not fitting:
        images = [name for name in names if name.lower().endswith(IMAGE_SUFFIXES)]
        other = [name for name in names if name.lower().endswith(OTHER_SUFFIXES)]
        if not images and other:
            raise InputError(
                f"{folder}: has images of a kind that is not read ({_some(other)}); "
                "convert them to PNG"
            )
        if not images:
            raise InputError(f"{folder}: has no images{_what_is_there(names)}")
        raise InputError(
            f"{folder}: does not name its views in a known way{_what_is_there(images)}; "
            "pass pattern (--pattern 'view_{v}_{u}.png', or 'view_{i}.png')"
        )
    return fitting[0]


def _numbered(
    folder: str, matches: list[re.Match[str]], grid: tuple[int, int] | None
) -> NamedViews:
    """Views numbered row by row, from 0 or 1, or from any number if none is missing."""
    by_number = _unique(folder, {match: int(match["i"]) for match in matches})
    lowest, highest = min(by_number), max(by_number)
    side = math.isqrt(len(by_number))
    wanted = side * side if grid is None else grid[0] * grid[1]
    whole = highest - lowest + 1 == len(by_number) == wanted
    first = lowest if whole or lowest == 1 else 0
    count = highest - first + 1
    if grid is None:
        side = math.isqrt(count)
        if side * side != count:
            raise InputError(
                f"{folder}: {count} views up to {by_number[highest].string!r} form no square; "
                "add the missing ones or pass grid (--grid V U)"
            )
        grid = (side, side)
        if whole and count not in (1, USUAL_COUNT):
            warnings.warn(
                f"{folder}: {count} views taken as {side}x{side}; "
                "pass grid (--grid V U) if they are not",
                GridWarning,
                stacklevel=2,
            )
    rows, columns = grid
    sample = matches[0]
    missing = [n for n in range(first, first + rows * columns) if n not in by_number]
    _refuse_missing(folder, grid, [_renamed(sample, {"i": n}) for n in missing])
    if count > rows * columns:
        raise InputError(
            f"{folder}: {by_number[highest].string!r} is beyond the {rows}x{columns} grid; "
            "pass the right grid (--grid V U)"
        )
    return NamedViews(grid, {divmod(n - first, columns): match for n, match in by_number.items()})


def _placed(folder: str, matches: list[re.Match[str]], grid: tuple[int, int] | None) -> NamedViews:
    """Views named by row and column, from any first row and column."""
    places = _unique(folder, {match: (int(match["v"]), int(match["u"])) for match in matches})
    rows, columns = sorted({v for v, _ in places}), sorted({u for _, u in places})
    first_v, first_u = rows[0], columns[0]  # 0, 1, or anywhere in a crop of a larger grid
    found = (rows[-1] - first_v + 1, columns[-1] - first_u + 1)
    grid = grid or found
    if found[0] > grid[0] or found[1] > grid[1]:
        raise InputError(
            f"{folder}: has {found[0]}x{found[1]} views, not {grid[0]}x{grid[1]}; "
            f"pass grid (--grid {found[0]} {found[1]})"
        )
    wanted = [(first_v + v, first_u + u) for v in range(grid[0]) for u in range(grid[1])]
    missing = [place for place in wanted if place not in places]
    _refuse_missing(folder, grid, [_renamed(matches[0], {"v": v, "u": u}) for v, u in missing])
    return NamedViews(grid, {(v - first_v, u - first_u): m for (v, u), m in places.items()})


def _unique(folder: str, keys: dict) -> dict:
    """Matches by key, refusing two files for one view."""
    unique: dict = {}
    for match, key in keys.items():
        if key in unique:
            raise InputError(
                f"{folder}: {unique[key].string!r} and {match.string!r} are the same view; "
                "remove one"
            )
        unique[key] = match
    return unique


def _renamed(sample: re.Match[str], numbers: dict[str, int]) -> str:
    """The name that another view would have."""
    name, cut = sample.string, 0
    text = ""
    for field, number in sorted(numbers.items(), key=lambda item: sample.start(item[0])):
        text += name[cut : sample.start(field)] + str(number).zfill(len(sample[field]))
        cut = sample.end(field)
    positions_follow = "y" in sample.groupdict()
    return text + ("_..." if positions_follow else name[cut:])


def _refuse_missing(folder: str, grid: tuple[int, int], missing: list[str]) -> None:
    """Name the views that are not there."""
    if missing:
        are, them = ("is", "it") if len(missing) == 1 else ("are", "them")
        raise InputError(
            f"{folder}: {len(missing)} of the {grid[0]}x{grid[1]} views {are} missing "
            f"({_some(missing)}); add {them} or pass the right grid (--grid V U)"
        )


def _some(names: list[str]) -> str:
    """The first few of a list."""
    return ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")


def _what_is_there(names: list[str]) -> str:
    """What the folder has instead."""
    return f" (it has: {_some(names)})" if names else " (it is empty)"
