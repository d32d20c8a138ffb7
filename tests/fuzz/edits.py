"""Edits that damage the bytes of a file."""

import random
import re
from typing import NamedTuple

NUMBERS = (0, 1, 2**15, 2**16 - 1, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
"""Integers that overflow, or claim sizes far beyond the file."""

DIGITS = (b"0", b"-1", b"99999999999999999999", b"1e308", b"nan", b"1" * 5000)
"""Texts in place of a number."""

TEXTS = (b"((((", b"[" * 3000, b"\x00", b'"', b"null", b"{}", b"\xff\xfe", b"\n", b" " * 300)
"""Texts that parsers stumble over."""

KINDS = (
    *("bit", "byte", "word", "word at the start", "number", "text"),
    *("cut", "delete", "repeat", "splice", "random"),
)


class Edit(NamedTuple):
    """One edit.

    Attributes:
        kind: One of :data:`KINDS`.
        place: Where, in 2^16 parts of the length.
        value: Any 32-bit number; its meaning depends on the kind.
    """

    kind: str
    place: int
    value: int


def apply(data, edits):
    """Return the bytes after all edits."""
    for edit in edits:
        data = _apply(data, *edit)
    return data


def _apply(data, kind, place, value):
    length = len(data)
    start = place * length >> 16
    end = min(length, start + 1 + value % 64)
    if kind == "random":
        return random.Random(value).randbytes(value % 200)
    if kind == "cut":
        return data[:start]
    if kind == "delete":
        return data[:start] + data[end:]
    if kind == "repeat":
        return data[:end] + data[start:]
    if kind == "splice":
        target = value * length >> 32
        return data[:target] + data[start:end] + data[target + end - start :]
    if kind == "text":
        return data[:start] + TEXTS[value % len(TEXTS)] + data[start:]
    if kind == "number":
        found = re.compile(rb"\d+(\.\d+)?").search(data, start) or re.search(rb"\d+", data)
        if found is None:
            return data
        return data[: found.start()] + DIGITS[value % len(DIGITS)] + data[found.end() :]
    if kind in ("word", "word at the start"):
        start = start if kind == "word" else place % 64
        size, order = (2, 4)[value % 2], ("little", "big")[value // 2 % 2]
        number = NUMBERS[value // 4 % len(NUMBERS)] % 256**size
        return data[:start] + number.to_bytes(size, order) + data[start + size :]
    if not data:
        return data
    start = min(start, length - 1)
    changed = data[start] ^ 1 << value % 8 if kind == "bit" else value % 256
    return data[:start] + bytes([changed]) + data[start + 1 :]


def random_edits(seed):
    """Return one to four random edits; the same for the same seed."""
    generator = random.Random(seed)
    return [
        Edit(generator.choice(KINDS), generator.getrandbits(16), generator.getrandbits(32))
        for _ in range(generator.randint(1, 4))
    ]
