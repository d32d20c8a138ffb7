"""The patterns that fit file names of an unknown layout."""

from __future__ import annotations

import itertools
import math
import re
from collections import defaultdict
from pathlib import PurePosixPath

from occjax.io.images import IMAGE_SUFFIXES

_FIELD = re.compile(
    r"(?:(?<![A-Za-z\d])[+-])?\d+"
    r"|(?<![A-Za-z])[A-Za-z](?![A-Za-z])"
    r"|(?<![A-Z])[A-Z](?=[A-Z]?(?![A-Za-z]))"
    r"|(?<=(?<![A-Z])[A-Z])[A-Z](?![A-Za-z])"
)
"""A number, a letter that stands alone, or each of one or two capitals at the end of a word. A sign
after a letter or digit is a separator."""


def fitting_patterns(names: list[str]) -> list[str]:
    """Return the patterns that fit the names of the images in a folder.

    The names may differ in any number of fields, for instance in the row, the column, and the
    camera position. Two fields that take all combinations of their values are row and column. If
    there are none, two fields that take at least half of them are, else one field that differs in
    all names is the number of the view. Files of several suffixes are read together, unless those
    of one suffix alone fill a grid.

    Args:
        names: Names of the images, which may contain folders.

    Returns:
        Patterns for :func:`~occjax.io.naming.patterns.pattern_to_regex`; more than one if several
        pairs of fields fill a grid; empty if nothing fits.

    Example:
        >>> fitting_patterns(["x+0_-1_8.png", "x+0_+0_9.png", "x+1_-1_7.png", "x+1_+0_3.png"])
        ['x+{v}_{u}_*.png']
    """
    groups = defaultdict(list)
    for name in names:
        path = PurePosixPath(name)
        if path.suffix:  # A file named ".png" has none.
            groups[_FIELD.sub("\0", _stem(path))].append(path)
    if not groups:
        return []
    template, paths = max(groups.items(), key=lambda item: len({_stem(path) for path in item[1]}))
    by_suffix = defaultdict(list)
    for path in paths:
        by_suffix[path.suffix].append(_stem(path))
    stems = dict(sorted(by_suffix.items(), key=_frequent_first))
    together = [_stem(path) for path in paths]
    if len(stems) > 1 and len(set(together)) == len(together):
        stems = {".*": together, **stems}
    readings = {
        suffix: _fitting(template, suffix, group)
        for suffix, group in stems.items()
        if len(group) > len({_stem(PurePosixPath(name)) for name in names}) / 2
    }
    filling_first = sorted(readings.values(), key=lambda reading: not reading[1])
    return filling_first[0][0] if filling_first else []


def _stem(path: PurePosixPath) -> str:
    """Return a relative path without the suffix."""
    return str(path.with_suffix(""))


def _frequent_first(item: tuple[str, list[str]]) -> tuple[int, int]:
    """Return a key that sorts suffixes with their stems: the most frequent suffix first."""
    suffix, stems = item
    return -len(stems), IMAGE_SUFFIXES.index(suffix.lower())


def _fitting(template: str, suffix: str, stems: list[str]) -> tuple[list[str], bool]:
    """Return the patterns that fit names of one template, and whether the names fill a grid."""
    columns = list(zip(*(_FIELD.findall(stem) for stem in stems), strict=True))
    # Fields that are equal in the same names vary in the same way; the first of them is used.
    different: dict[tuple[int, ...], int] = {}
    for index, values in enumerate(columns):
        if len(set(values)) > 1:
            different.setdefault(tuple(map(values.index, values)), index)
    fields = list(different.values())
    fixed = {index: values[0] for index, values in enumerate(columns) if len(set(values)) == 1}
    pairs = {
        (a, b): len(stems) / (len(set(columns[a])) * len(set(columns[b])))
        for a, b in itertools.combinations(fields, 2)
        if len(set(zip(columns[a], columns[b], strict=True))) == len(stems)
    }
    full = [pair for pair, filled in pairs.items() if filled == 1.0]
    chosen = full or [pair for pair, filled in pairs.items() if filled >= 0.5]
    if chosen:
        patterns = [_pattern(template, suffix, fixed | {a: "{v}", b: "{u}"}) for a, b in chosen]
        return patterns, bool(full)
    numbers = [index for index in fields if len(set(columns[index])) == len(stems)]
    patterns = [_pattern(template, suffix, fixed | {index: "{i}"}) for index in numbers[:1]]
    return patterns, bool(patterns) and math.isqrt(len(stems)) ** 2 == len(stems)


def _pattern(template: str, suffix: str, fields: dict[int, str]) -> str:
    """Write fields into the template by their number; the others become ``*``."""
    numbers = itertools.count()
    return re.sub("\0", lambda _: fields.get(next(numbers), "*"), template) + suffix
