"""Arrays of HDF5 files from unknown sources."""

from __future__ import annotations

import math
import mmap
import struct
from io import BufferedReader
from pathlib import Path
from typing import Any

import numpy as np

from occjax.io.files import decoding, file_size
from occjax.io.limits import ReadLimits


def read_dataset(path: Path, stored: Any) -> np.ndarray:
    """Read an array of an HDF5 file, after a check of its size.

    Args:
        path: File, for messages.
        stored: The ``h5py.Dataset``.

    Raises:
        InputError: If the array is damaged, too large, or stored in another file.
    """
    with decoding(path, "an HDF5 file", max_bytes=math.inf) as file:
        if stored.external or stored.is_virtual:
            raise ValueError(f"{stored.name} is stored in another file")
        largest = max(math.prod(stored.shape), math.prod(stored.chunks or ()))
        count = largest * stored.dtype.itemsize
        ReadLimits.current().check_bytes(path, count, file_size(file))
        return np.asarray(stored)


def check_heaps(file: BufferedReader) -> None:
    """Check the global heaps of an HDF5 file, in which attributes of variable length are stored.

    The HDF5 library (2.0 and before) does not end if an object of a heap has the size 0. The format
    is section III.E of the HDF5 file format specification.

    Raises:
        ValueError: If the sizes of the objects of a heap do not fit its size.
    """
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        start, steps = -1, 0
        while (start := data.find(b"GCOL\x01\0\0\0", start + 1)) >= 0:
            place, end = start + 16, start + int.from_bytes(data[start + 8 : start + 16], "little")
            if end > len(data):
                raise ValueError("a heap is cut short")
            while place + 16 <= end:
                index, size = struct.unpack_from("<H6xQ", data, place)
                steps += 1
                place += size if index == 0 else 16 + size + -size % 8
                if (index == 0 and size < 16) or place > end or 16 * steps > len(data):
                    raise ValueError("an object of a heap has an impossible size")
