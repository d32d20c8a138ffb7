"""Portable float maps (PFM), the format in which this field stores disparity.

A PFM file is a text header of ``PF`` (colour) or ``Pf`` (grey), width, height and scale, followed
by 32-bit floats, bottom row first. The sign of the scale gives the byte order (negative is
little-endian). Its magnitude is a display hint that disparity files fill inconsistently (1, 1/255,
...), so the values are taken as they are, as all readers of this field do.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

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
    return decode_pfm(data, path)


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
    data = encode_pfm(image, path)
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


class PfmHeader(NamedTuple):
    """What the header of a PFM file says.

    Attributes:
        height: Rows of pixels.
        width: Columns of pixels.
        channels: 1 (grey) or 3 (colour).
        little_endian: Whether that is the byte order of the values.
        start: Number of bytes before the values.
    """

    height: int
    width: int
    channels: int
    little_endian: bool
    start: int


def pfm_header(data: bytes, path: str | Path) -> PfmHeader:
    r"""Read the header of a PFM file's content.

    Args:
        data: The file's bytes.
        path: What to call it in an error.

    Raises:
        InputError: If there is no such header, or the length of what follows is not what it says.

    Example:
        >>> pfm_header(b"Pf\n2 1\n-1.0\n" + bytes(8), "map.pfm")
        PfmHeader(height=1, width=2, channels=1, little_endian=True, start=12)
    """
    (magic, columns, rows, scale), start = _header(path, data)
    channels = {"PF": 3, "Pf": 1}[magic]
    width, height = _size(path, columns), _size(path, rows)
    little_endian = _scale(path, scale) < 0
    expected, found = width * height * channels * 4, len(data) - start
    if found != expected:
        raise InputError(
            f"{path}: header says {width}x{height} pixels, which is {expected} bytes, but {found} "
            f"follow; the file is {'truncated' if found < expected else 'damaged'}, copy it again"
        )
    return PfmHeader(height, width, channels, little_endian, start)


def decode_pfm(data: bytes, path: str | Path) -> np.ndarray:
    """The image in a PFM file's content.

    Takes and raises what :func:`pfm_header` does; returns what :func:`read_pfm` does.
    """
    header = pfm_header(data, path)
    byte_order = "<f4" if header.little_endian else ">f4"
    pixels = np.frombuffer(data, byte_order, offset=header.start).astype(np.float32)
    image = pixels.reshape(header.height, header.width, header.channels)[::-1]
    return np.ascontiguousarray(image if header.channels == 3 else image[..., 0])


def encode_pfm(image: np.ndarray, path: str | Path) -> bytes:
    r"""A PFM file's content; see :func:`write_pfm`.

    Args:
        image: ``[H, W]`` or ``[H, W, 3]``, top row first.
        path: What to call it in an error.

    Raises:
        InputError: If the array has another shape.

    Example:
        >>> encode_pfm(np.array([[1.0]]), "map.pfm")
        b'Pf\n1 1\n-1.0\n\x00\x00\x80?'
    """
    if image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)) or image.size == 0:
        raise InputError(
            f"{path}: a PFM file holds [H, W] or [H, W, 3], not {list(image.shape)}; pass one map"
        )
    height, width = image.shape[:2]
    header = f"{'Pf' if image.ndim == 2 else 'PF'}\n{width} {height}\n-1.0\n"
    return header.encode("ascii") + image[::-1].astype("<f4").tobytes()


def _header(path: str | Path, data: bytes) -> tuple[list[str], int]:
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


def _size(path: str | Path, word: str) -> int:
    """Width or height."""
    if not word.isdecimal() or int(word) == 0:
        raise InputError(f"{path}: {word[:20]!r} in the header is no image size; write it again")
    return int(word)


def _scale(path: str | Path, word: str) -> float:
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
