"""Portable float maps (PFM), the format in which this field stores disparity.

A PFM file has a text header of ``PF`` (colour) or ``Pf`` (grey), width, height and scale, followed
by 32-bit floats, bottom row first. The sign of the scale gives the byte order (negative is
little-endian). Its magnitude is a display hint that disparity files fill inconsistently (1, 1/255,
...), so the values are not scaled, as in all readers of this field.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.config import ReadingConfig
from occjax.io.files import decoding


def read_pfm(path: str | Path) -> np.ndarray:
    r"""Read a PFM file.

    Args:
        path: File with grey or colour floats in either byte order. The header may have comments
            that start with ``#``, and Windows line ends.

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
    with decoding(path, "a PFM file") as file:
        data = file.read()
    return decode_pfm(data, path)


def write_pfm(path: str | Path, image: np.ndarray) -> None:
    r"""Write a PFM file of 32-bit little-endian floats (scale -1), atomically.

    Args:
        path: File to write; an existing file is replaced.
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
    """The header of a PFM file.

    Attributes:
        height: Rows of pixels.
        width: Columns of pixels.
        channels: 1 (grey) or 3 (colour).
        little_endian: Byte order of the values.
        start: Number of bytes before the values.
    """

    height: int
    width: int
    channels: int
    little_endian: bool
    start: int


def pfm_header(data: bytes, path: str | Path) -> PfmHeader:
    r"""Read the header of a PFM file from its bytes.

    Args:
        data: All bytes of the file.
        path: Name of the file for messages.

    Raises:
        InputError: If there is no such header, or the values after it have another length.

    Example:
        >>> pfm_header(b"Pf\n2 1\n-1.0\n" + bytes(8), "map.pfm")
        PfmHeader(height=1, width=2, channels=1, little_endian=True, start=12)
    """
    if data[:2] not in (b"PF", b"Pf"):
        raise InputError(f"{path}: not a PFM file (it must start with PF or Pf); check its format")
    words: list[str] = []
    start = 0
    # The header ends with the line of its fourth word. Pixel bytes may look like white space, so
    # the header is split into lines first.
    while len(words) < 4:
        end = data.find(b"\n", start, 2**14) + 1  # the header must end there
        if end == 0:
            raise InputError(f"{path}: the PFM header is incomplete; copy the file again")
        words += data[start:end].split(b"#")[0].decode("ascii", errors="replace").split()
        start = end
    try:
        magic, columns, rows, factor = words
        channels = {"Pf": 1, "PF": 3}[magic]
        width, height, scale = int(columns), int(rows), float(factor)
    except (KeyError, ValueError):
        channels, width, height, scale = 0, 0, 0, 0.0
    too_long = max(map(len, words)) > 32  # numbers of real files are shorter
    if too_long or width < 1 or height < 1 or scale == 0.0 or not math.isfinite(scale):
        raise InputError(
            f"{path}: the PFM header is {' '.join(words)[:40]!r}; it must be PF or Pf, width, "
            "height and a scale other than 0 (-1.0 for little-endian values); write it again"
        )
    expected, found = width * height * channels * 4, len(data) - start
    if found != expected:
        raise InputError(
            f"{path}: header says {width}x{height} pixels, which is {expected} bytes, but {found} "
            f"follow; the file is {'truncated' if found < expected else 'damaged'}, copy it again"
        )
    return PfmHeader(height, width, channels, scale < 0, start)


def decode_pfm(data: bytes, path: str | Path) -> np.ndarray:
    r"""Return the image of a PFM file from its bytes, as :func:`read_pfm`.

    Args:
        data: All bytes of the file.
        path: Name of the file for messages.

    Raises:
        InputError: If the header, the length or the byte order is wrong.

    Example:
        >>> decode_pfm(b"Pf\n1 1\n-1.0\n" + bytes(4), "map.pfm").tolist()
        [[0.0]]
    """
    header = pfm_header(data, path)
    byte_order = "<f4" if header.little_endian else ">f4"
    stored = np.frombuffer(data, byte_order, offset=header.start)
    usual, swapped = _usual_fraction(stored), _usual_fraction(stored.byteswap())
    enough = stored.size >= ReadingConfig().min_byte_order_values
    if enough and usual < 0.5 and swapped > 0.9:
        order, sign = ("little", "positive") if header.little_endian else ("big", "negative")
        raise InputError(
            f"{path}: the header says that values are {order}-endian, but they are only plausible "
            f"in the other byte order; write a {sign} scale into the header"
        )
    pixels = stored.astype(np.float32)
    image = pixels.reshape(header.height, header.width, header.channels)[::-1]
    return np.ascontiguousarray(image if header.channels == 3 else image[..., 0])


def _usual_fraction(values: np.ndarray) -> float:
    """Return the fraction of the finite values other than 0 that are of a usual magnitude."""
    magnitudes = np.abs(values[np.isfinite(values) & (values != 0.0)])
    if not magnitudes.size:
        return 0.0
    return float(np.mean((magnitudes > 1e-9) & (magnitudes < 1e9)))


def encode_pfm(image: np.ndarray, path: str | Path) -> bytes:
    r"""Return the bytes of a PFM file; see :func:`write_pfm`.

    Args:
        image: ``[H, W]`` or ``[H, W, 3]``, top row first.
        path: Name of the file for messages.

    Returns:
        Header and 32-bit little-endian floats.

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
