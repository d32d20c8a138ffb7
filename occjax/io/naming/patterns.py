"""File name patterns and the indices in file names."""

from __future__ import annotations

import re
from collections.abc import Mapping

from occjax.errors import InputError
from occjax.io.images import IMAGE_SUFFIXES
from occjax.io.layouts import FolderLayout

_SUFFIX = r"\.(?:" + "|".join(suffix[1:] for suffix in IMAGE_SUFFIXES) + r")"
_NUMBER = r"-?\d+(?:\.\d+)?"

NAMES: Mapping[FolderLayout, re.Pattern[str]] = {
    "hci": re.compile(rf"input_Cam(?P<i>\d+){_SUFFIX}", re.IGNORECASE),
    "lytro": re.compile(
        rf"(?!out_\d+_\d+_+-?\d)(?P<scene>.+)_(?P<v>\d{{1,3}})_(?P<u>\d{{1,3}}){_SUFFIX}",
        re.IGNORECASE,
    ),
    "urbanlf": re.compile(rf"(?P<v>\d{{1,2}})_(?P<u>\d{{1,2}}){_SUFFIX}", re.IGNORECASE),
    "stanford": re.compile(
        rf"out_(?P<v>\d+)_(?P<u>\d+)_+(?P<y>{_NUMBER})_(?P<x>{_NUMBER})(?P<tail>_?){_SUFFIX}",
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


def is_in_subfolders(pattern: str | None) -> bool:
    """Return whether a file name pattern names files in subfolders.

    Example:
        >>> is_in_subfolders("{v}/{u}.png"), is_in_subfolders("{v}_{u}.png"), is_in_subfolders(None)
        (True, False, False)
    """
    return pattern is not None and "/" in pattern


def pattern_to_regex(pattern: str) -> re.Pattern[str]:
    """Turn a file name pattern with ``{v}`` and ``{u}``, or ``{i}``, into a regular expression.

    Args:
        pattern: For instance ``"view_{v}_{u}.png"``. A field matches a number, with or without a
            sign, or one letter. ``*`` matches any text without a slash, ``.*`` at the end the
            suffix of any image that is read.

    Raises:
        InputError: If the pattern does not have exactly those fields.

    Example:
        >>> pattern_to_regex("view_{v}-{u}*.png").fullmatch("view_3-12_left.png").groupdict()
        {'v': '3', 'u': '12'}
    """
    fields = re.findall(r"\{(.*?)\}", pattern)
    if sorted(fields) not in (["i"], ["u", "v"]):
        raise InputError(
            f"pattern {pattern!r} must contain {{v}} and {{u}} (row and column) or {{i}} (number), "
            "each once"
        )
    text, suffix = "", ""
    if pattern.endswith(".*"):
        pattern, suffix = pattern[:-2], f"(?i:{_SUFFIX})"
    for part in re.split(r"(\{[vui]\}|\*)", pattern):
        if part == "*":
            text += r"[^/]*?"
        elif part in ("{v}", "{u}", "{i}"):
            text += rf"(?P<{part[1]}>[+-]?\d+|[A-Za-z])"
        else:
            text += re.escape(part)
    return re.compile(text + suffix)


def index_value(text: str) -> int:
    """Return the index that a number or a letter in a file name stands for.

    Example:
        >>> index_value("007"), index_value("-3"), index_value("C")
        (7, -3, 2)
    """
    return ord(text.lower()) - ord("a") if text.isalpha() else int(text)


def index_text(index: int, like: str) -> str:
    """Write an index in the form of another one.

    Example:
        >>> index_text(7, "012"), index_text(2, "+1"), index_text(2, "A")
        ('007', '+2', 'C')
    """
    if like.isalpha():
        return chr(ord("A" if like.isupper() else "a") + index)
    return f"{index:+d}" if like[0] in "+-" else str(index).zfill(len(like))


def renamed(sample: re.Match[str], indices: dict[str, int]) -> str:
    """Return the file name that another view would have.

    Args:
        sample: Matched file name of one view.
        indices: Index of the other view in each field of the name.
    """
    name, end = sample.string, 0
    text = ""
    for field, index in sorted(indices.items(), key=lambda item: sample.start(item[0])):
        text += name[end : sample.start(field)] + index_text(index, sample[field])
        end = sample.end(field)
    has_position = "y" in sample.groupdict()
    return text + ("_..." if has_position else name[end:])
