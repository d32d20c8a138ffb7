"""Search for the views of a light field among the files of a folder."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import PurePosixPath

from occjax.errors import InputError, warn
from occjax.io.hdr import HDR_SUFFIXES
from occjax.io.images import (
    IMAGE_SUFFIXES,
    PLENOPTIC_REMEDY,
    PLENOPTIC_SUFFIXES,
    UNSUPPORTED_SUFFIXES,
)
from occjax.io.naming.arrangement import (
    GridWarning,
    NamedViews,
    arrange_by_number,
    arrange_by_row_and_column,
    first_few,
)
from occjax.io.naming.fitting_patterns import fitting_patterns
from occjax.io.naming.patterns import EXAMPLES, NAMES, FolderLayout, pattern_to_regex


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
        GridWarning: If the names are read by a pattern that was found.
    """
    names = sorted(names)
    usual = [name for name in names if not name.lower().endswith(HDR_SUFFIXES)]
    if pattern is None and any(name.lower().endswith(IMAGE_SUFFIXES) for name in usual):
        names = usual  # depth maps are often stored as EXR next to the views
    if pattern is not None:
        matches, expected = _matching(names, pattern_to_regex(pattern)), f"matches {pattern!r}"
    elif layout is None and (layout := _detect_layout(folder, names)) is None:
        proposed = _propose(folder, names, grid)
        return None, find_views(folder, names, pattern=proposed, grid=grid)[1]
    else:
        matches = _matching(names, NAMES[layout])
        expected = f"is named like {EXAMPLES[layout]!r}"
    if not matches:
        raise InputError(f"{folder}: no file {expected}{_found(names)}")
    _warn_of_ignored(folder, names, matches)
    scenes = {match.groupdict().get("scene") for match in matches}
    if len(scenes) > 1:
        patterns = fitting_patterns([match.string for match in matches])
        option = f", or {_pass_pattern(patterns)}"
        raise InputError(
            f"{folder}: has views of several scenes ({first_few(sorted(map(str, scenes)))}); "
            f"move each to a folder of its own{option if patterns else ''}"
        )
    arrange = arrange_by_number if "i" in matches[0].groupdict() else arrange_by_row_and_column
    return layout, arrange(folder, matches, grid)


def _warn_of_ignored(folder: str, names: list[str], matches: list[re.Match[str]]) -> None:
    """Warn of images that are ignored only because their suffix differs from that of the views.

    An image that has the name of a view but another suffix is not reported.
    """
    read = {PurePosixPath(match.string).with_suffix("") for match in matches}
    sample = matches[0]
    ignored = [
        path.name
        for path in map(PurePosixPath, names)
        if path.with_suffix("") not in read
        and path.name.lower().endswith((*IMAGE_SUFFIXES, *UNSUPPORTED_SUFFIXES))
        and sample.re.fullmatch(str(path.with_suffix(PurePosixPath(sample.string).suffix)))
    ]
    if ignored:
        warn(
            f"{folder}: {len(matches)} views are read, {len(ignored)} images of another suffix "
            f"are ignored ({first_few(ignored)}); convert them to PNG, or end pattern (--pattern) "
            "with .* to read all suffixes",
            GridWarning,
        )


def _matching(names: list[str], regex: re.Pattern[str]) -> list[re.Match[str]]:
    """Return the matches of the names that match as a whole."""
    return [match for match in map(regex.fullmatch, names) if match]


def _detect_layout(folder: str, names: list[str]) -> FolderLayout | None:
    """Return the only layout that fits names of the folder; None if no layout fits."""
    fitting = [layout for layout, regex in NAMES.items() if _matching(names, regex)]
    if len(fitting) == 1:
        known = {match.string for match in _matching(names, NAMES[fitting[0]])}
        images = [name for name in names if name.lower().endswith(IMAGE_SUFFIXES)]
        if known < set(images) and len(patterns := fitting_patterns(images)) == 1:
            found = {match.string for match in _matching(names, pattern_to_regex(patterns[0]))}
            if known < found:
                return None  # for instance view_-1_0.png: layouts have no negative indices
        return fitting[0]
    if fitting:
        raise InputError(
            f"{folder}: has files of several layouts ({', '.join(fitting)}); "
            f"pass layout (--layout {fitting[0]}, or another of them)"
        )
    return None


def _propose(folder: str, names: list[str], grid: tuple[int, int] | None) -> str:
    """Return the only pattern that fits the names of the images in the folder."""
    images = [name for name in names if name.lower().endswith(IMAGE_SUFFIXES)]
    unsupported = [name for name in names if name.lower().endswith(UNSUPPORTED_SUFFIXES)]
    if not images and unsupported:
        raise InputError(
            f"{folder}: has images in an unsupported format ({first_few(unsupported)}); "
            "convert them to PNG"
        )
    patterns = fitting_patterns(images)
    undecoded = [name for name in names if name.lower().endswith(PLENOPTIC_SUFFIXES)]
    if undecoded and not patterns:
        raise InputError(f"{folder}/{undecoded[0]}: {PLENOPTIC_REMEDY}")
    if not images:
        raise InputError(f"{folder}: has no images{_found(names)}")
    if len(patterns) == 1:
        warn(
            f"{folder}: file names read by --pattern {patterns[0]!r}; pass another if it is wrong",
            GridWarning,
        )
        return patterns[0]
    no_layout = f"{folder}: the file names match no known layout{_found(images)}"
    if patterns:
        raise InputError(f"{no_layout}; {_pass_pattern(patterns)}")
    stated = re.search(r"(?<!\d)(\d{1,2})x(\d{1,2})(?!\d)", images[0])
    rows, columns = grid or (stated.groups() if stated else ("V", "U"))
    raise InputError(
        f"{no_layout}; if each image holds all views, name one of them, such as "
        f"{folder}/{images[0]}, and pass grid (--grid {rows} {columns}); if each is one view, "
        f"{_pass_pattern(['view_{v}_{u}.png', 'view_{i}.png'])}"
    )


def _pass_pattern(patterns: list[str]) -> str:
    """Tell the user to choose one of some patterns."""
    return f"pass pattern (--pattern {' or '.join(map(repr, patterns))})"


def _found(names: list[str]) -> str:
    """Describe the files that a folder contains instead of the expected ones."""
    return f" (it has: {first_few(names)})" if names else " (it is empty)"
