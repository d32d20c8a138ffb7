"""Reader of the numeric arrays of ``.mat`` files of versions 5 to 7.

``scipy.io.loadmat`` is not used, because damaged files can crash the process in its compiled code.
The format is that of MathWorks, "MAT-File Format": a header of 128 bytes, then elements of a type,
a length and content; an array is an element that contains elements.
"""

from __future__ import annotations

import math
import struct
import zlib
from pathlib import Path

import numpy as np

from occjax.io.files import decoding
from occjax.io.limits import ReadLimits

_HEADER_BYTES = 128
_MATRIX, _COMPRESSED = 14, 15

_TYPES = dict(enumerate(("i1", "u1", "i2", "u2", "i4", "u4", "f4"), start=1))
_TYPES |= {9: "f8", 12: "i8", 13: "u8"}
"""NumPy's name of each type of stored numbers."""

_CLASSES = dict(enumerate(("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"), start=6))
"""NumPy's name of each numeric class of arrays; their numbers may be stored in a smaller type."""

_COMPLEX_FLAG = 0x800

_MAX_START_BYTES = 2**12
"""Number of bytes in which flags, sizes and name of an array must end."""


def read_mat_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read the real numeric arrays of a ``.mat`` file; others are left out.

    Args:
        path: File of version 5, 6 or 7; version 7.3 is HDF5.

    Returns:
        The arrays by name.

    Raises:
        InputError: If the file is damaged, has another version, or is too large.
    """
    with decoding(path, "a MATLAB file") as file:
        data = file.read()
        order = {b"IM": "<", b"MI": ">"}.get(data[126:_HEADER_BYTES])
        if order is None:
            raise ValueError("it is not of version 5, 6 or 7; save it by save(..., '-v7')")
        limits, total, arrays = ReadLimits.current(), 0, {}
        place = _HEADER_BYTES
        while place < len(data):
            kind, length = struct.unpack_from(f"{order}II", data, place)
            body = data[place + 8 : place + 8 + length]
            place += 8 + length
            inflate = zlib.decompressobj()
            if kind == _COMPRESSED:
                body = inflate.decompress(body, _MAX_START_BYTES)
                kind, body = struct.unpack_from(f"{order}I", body)[0], body[8:]
            if kind != _MATRIX:
                continue
            flags, sizes, name, start = _array_start(body[:_MAX_START_BYTES], order)
            if flags & _COMPLEX_FLAG or flags & 0xFF not in _CLASSES:
                continue
            dtype = np.dtype(_CLASSES[flags & 0xFF])
            total += math.prod(sizes) * dtype.itemsize
            limits.check_bytes(path, total, len(data))
            # Adds nothing to an array that is not compressed.
            body += inflate.decompress(inflate.unconsumed_tail, math.prod(sizes) * 8 + 64)
            stored, numbers, _ = _element(body, start, order)
            values = np.frombuffer(numbers, order + _TYPES[stored], math.prod(sizes))
            arrays[name] = values.astype(dtype).reshape(sizes, order="F")
    return arrays


def _array_start(body: bytes, order: str) -> tuple[int, tuple[int, ...], str, int]:
    """Return flags, sizes and name of an array, and the place of the element of its numbers."""
    _, flags, place = _element(body, 0, order)
    _, sizes, place = _element(body, place, order)
    _, name, place = _element(body, place, order)
    dimensions = struct.unpack(f"{order}{len(sizes) // 4}i", sizes)
    if min(dimensions) < 0:
        raise ValueError("an array has a negative size")
    return struct.unpack_from(f"{order}I", flags)[0], dimensions, name.decode("ascii"), place


def _element(body: bytes, place: int, order: str) -> tuple[int, bytes, int]:
    """Return type and content of an element, and the place of the next one.

    A short element has its length in the upper half of its type, and up to 4 bytes of content.
    """
    kind, length = struct.unpack_from(f"{order}II", body, place)
    if kind >> 16:
        return kind & 0xFFFF, body[place + 4 : place + 4 + (kind >> 16)], place + 8
    content = body[place + 8 : place + 8 + length]
    if len(content) < length:
        raise ValueError("an array is cut short")
    return kind, content, place + 8 + length + -length % 8
