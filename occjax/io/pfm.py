"""Portable float maps (PFM), the format in which this field stores disparity.

A PFM file is a text header of ``PF`` (colour) or ``Pf`` (grey), width, height and scale, followed
by 32-bit floats, bottom row first. The sign of the scale gives the byte order (negative is
little-endian). Its magnitude is a display hint that disparity files fill inconsistently (1, 1/255,
...), so the values are taken as they are, as all readers of this field do.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.files import reading


def read_pfm(path: str | Path) -> np.ndarray:
    r"""Read a PFM file.

    Args:
        path: File with grey or colour floats in either byte order; comment lines starting with
            ``#`` and Windows line ends in the header are understood.

    Returns:
        ``[H, W]`` (grey) or ``[H, W, 3]`` (colour) float32, top row first.

    Raises:
        InputError: If the file cannot be read, or its header or length is wrong.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "row.pfm"
        >>> _ = path.write_bytes(b"Pf 2 1 -1.0\n" + np.array([1, 2], "<f4").tobytes())
        >>> read_pfm(path).tolist()
        [[1.0, 2.0]]
    """
    path = Path(path)
    with reading(path):
        data = path.read_bytes()
    (magic, columns, rows, scale), start = _header(path, data)
    channels = {"PF": 3, "Pf": 1}[magic]
    width, height = _size(path, columns), _size(path, rows)
    byte_order = "<f4" if _scale(path, scale) < 0 else ">f4"
    expected, found = width * height * channels * 4, len(data) - start
    if found != expected:
        raise InputError(
            f"{path}: header says {width}x{height} pixels, which is {expected} bytes, but {found} "
            f"follow; the file is {'truncated' if found < expected else 'damaged'}, copy it again"
        )
    pixels = np.frombuffer(data, byte_order, offset=start).astype(np.float32)
    image = pixels.reshape(height, width, channels)[::-1]
    return np.ascontiguousarray(image if channels == 3 else image[..., 0])


def write_pfm(path: str | Path, image: np.ndarray) -> None:
    r"""Write a PFM file atomically: 32-bit little-endian floats, scale -1.

    Args:
        path: File to write; one that is there is replaced.
        image: ``[H, W]`` or ``[H, W, 3]``, top row first.

    Raises:
        InputError: If the array has another shape, or the file cannot be written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "disparity.pfm"
        >>> write_pfm(path, np.array([[0.5, -1.5]]))
        >>> path.read_bytes()[:12]
        b'Pf\n2 1\n-1.0\n'
    """
    if image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)) or image.size == 0:
        raise InputError(
            f"{path}: a PFM file holds [H, W] or [H, W, 3], not {list(image.shape)}; pass one map"
        )
    height, width = image.shape[:2]
    header = f"{'Pf' if image.ndim == 2 else 'PF'}\n{width} {height}\n-1.0\n"
    with atomic_path(path) as temporary:
        temporary.write_bytes(header.encode("ascii") + image[::-1].astype("<f4").tobytes())


def _header(path: Path, data: bytes) -> tuple[list[str], int]:
    """The four words of the header, and where the pixels start.

    The header ends with the line of its fourth word. Going by lines keeps pixel bytes that look
    like white space out of the header.
    """
    if data[:2] not in (b"PF", b"Pf"):
        raise InputError(f"{path}: not a PFM file (it must start with PF or Pf); check its format")
    words: list[str] = []
    start = 0
    while len(words) < 4:
        end = data.find(b"\n", start) + 1
        if end == 0:
            raise InputError(f"{path}: the PFM header is incomplete; copy the file again")
        line = data[start:end].split(b"#")[0]
        words += line.decode("ascii", errors="replace").split()
        start = end
    if len(words) > 4 or words[0] not in ("PF", "Pf"):
        raise InputError(
            f"{path}: the PFM header reads {' '.join(words)[:40]!r}, not magic, width, height, "
            "scale; write the file again"
        )
    return words, start


def _size(path: Path, word: str) -> int:
    """Width or height."""
    if not word.isdecimal() or int(word) == 0:
        raise InputError(f"{path}: {word[:20]!r} in the header is no image size; write it again")
    return int(word)


def _scale(path: Path, word: str) -> float:
    """The scale, whose sign is the byte order."""
    try:
        scale = float(word)
    except ValueError:
        scale = math.nan
    if not math.isfinite(scale) or scale == 0.0:
        raise InputError(
            f"{path}: the scale in the header is {word[:20]!r}; it must be a number other than "
            "zero, -1.0 for little-endian values"
        )
    return scale
