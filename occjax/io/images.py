"""Reading one image: PNG, JPEG and TIFF of 8 and 16 bits, with the fault named if it is damaged."""

from __future__ import annotations

import io
import struct
import threading
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

from occjax.errors import InputError
from occjax.io.files import reading

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
"""File name endings that are taken for images, in lower case."""

OTHER_SUFFIXES = (
    *(".webp", ".gif", ".avif", ".heic", ".heif", ".jp2", ".exr", ".hdr"),
    *(".ppm", ".pgm", ".tga", ".dng", ".raw"),
)
"""File name endings of images that are not read."""

_DECODING_ERRORS = (
    OSError,
    ValueError,
    SyntaxError,
    EOFError,
    struct.error,
    zlib.error,
    tifffile.TiffFileError,
)

_TIFF_BLACK, _TIFF_RGB = 1, 2  # values of the tag PhotometricInterpretation


def read_image(path: str | Path) -> np.ndarray:
    """Read an image as it is stored.

    Args:
        path: PNG, JPEG, TIFF or BMP file. An alpha channel is dropped; palettes are resolved.

    Returns:
        ``[H, W, C]`` uint8, uint16 or (TIFF) float32, C is 1 or 3.

    Raises:
        InputError: If the file cannot be read, is no image, or is damaged.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "grey.png"
        >>> Image.fromarray(np.uint8([[0, 128]])).save(path)
        >>> read_image(path).tolist()
        [[[0], [128]]]
    """
    path = Path(path)
    with reading(path):
        data = path.read_bytes()
    try:
        with _any_size():
            image = _decode(data)
    except _DECODING_ERRORS as error:
        reason = " ".join(str(error).split())[:120]
        if "imagecodecs" in reason:
            raise InputError(
                f"{path}: this TIFF compression needs another package; run pip install imagecodecs"
            ) from error
        if isinstance(error, Image.UnidentifiedImageError):
            reason = "not an image"
        raise InputError(
            f"{path}: cannot be decoded ({reason}); write or copy the image again"
        ) from error
    return _without_alpha(path, image)


def read_png_text(path: str | Path) -> dict[str, str]:
    """What a PNG says about itself in its text chunks, by keyword; nothing for other images.

    Args:
        path: An image file.

    Raises:
        InputError: If the file cannot be read, is no image, or is damaged.
    """
    path = Path(path)
    with reading(path):
        data = path.read_bytes()
    try:
        with _any_size(), Image.open(io.BytesIO(data)) as image:
            return {key: str(value) for key, value in getattr(image, "text", {}).items()}
    except _DECODING_ERRORS as error:
        raise InputError(f"{path}: its text cannot be decoded; copy the image again") from error


def _decode(data: bytes) -> np.ndarray:
    """Pixels, by the decoder that keeps all their bits."""
    if data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return _tiff(data)
    return _deep_colour_png(data) if _is_deep_colour_png(data) else _with_pillow(data)


class _Readers:
    """How many threads are decoding, and Pillow's limit on the size of images before they began."""

    lock = threading.Lock()
    count = 0
    limit: int | None = None


@contextmanager
def _any_size() -> Iterator[None]:
    """Lift Pillow's limit, which mosaics of many views exceed, while any thread is decoding.

    The limit is a global of Pillow; programs that rely on it find it as it was.
    """
    with _Readers.lock:
        if _Readers.count == 0:
            _Readers.limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        _Readers.count += 1
    try:
        yield
    finally:
        with _Readers.lock:
            _Readers.count -= 1
            if _Readers.count == 0:
                Image.MAX_IMAGE_PIXELS = _Readers.limit


def _with_pillow(data: bytes) -> np.ndarray:
    """Any image of 8 bits, and grey ones of 16."""
    with Image.open(io.BytesIO(data)) as image:
        if image.mode in ("L", "LA", "RGB", "RGBA"):
            return np.asarray(image)
        if image.mode.startswith("I;16"):
            return np.asarray(image).astype(np.uint16)
        return np.asarray(image.convert("L" if image.mode == "1" else "RGB"))


def _tiff(data: bytes) -> np.ndarray:
    """Pillow knows every compression of 8-bit TIFF, tifffile every depth."""
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        page = file.pages.first
        if page.bitspersample == 8 and page.sampleformat == 1:
            return _with_pillow(data)
        if page.photometric not in (_TIFF_BLACK, _TIFF_RGB):
            raise ValueError("TIFF is neither grey nor RGB")
        image = page.asarray()
        planes_first = page.planarconfig == 2 and image.ndim == 3
        return np.moveaxis(image, 0, -1) if planes_first else image


def _is_deep_colour_png(data: bytes) -> bool:
    """A PNG of 16 bits with more than one channel."""
    return data[:8] == b"\x89PNG\r\n\x1a\n" and data[24:25] == b"\x10" and data[25:26] != b"\0"


def _deep_colour_png(data: bytes) -> np.ndarray:
    """16-bit colour, of which Pillow returns the upper bytes only.

    PNG filters every byte of a pixel on its own, so exchanging the two bytes of each sample in the
    filtered rows exchanges them in the decoded image: a second pass returns the lower bytes.
    """
    width, height, _, colour_type, _, _, interlace = struct.unpack(">IIBBBBB", data[16:29])
    if interlace:
        raise ValueError("interlaced PNG of 16 bits")
    with Image.open(io.BytesIO(data)) as image:
        upper = np.asarray(image)
    channels = {2: 3, 4: 2, 6: 4}[colour_type]
    chunks = _png_chunks(data)
    rows = np.frombuffer(zlib.decompress(b"".join(chunks[b"IDAT"])), np.uint8)
    rows = rows.reshape(height, 1 + 2 * channels * width).copy()
    samples = rows[:, 1:].reshape(height, channels * width, 2)
    samples[...] = samples[..., ::-1].copy()
    exchanged = (
        data[:8]
        + _png_chunk(b"IHDR", data[16:29])
        + _png_chunk(b"IDAT", zlib.compress(rows.tobytes(), 1))
        + _png_chunk(b"IEND", b"")
    )
    with Image.open(io.BytesIO(exchanged)) as image:
        lower = np.asarray(image)
    both = upper.astype(np.uint16) << 8 | lower
    return both[..., :1] if colour_type == 4 else both  # grey with alpha comes as colour


def _png_chunks(data: bytes) -> dict[bytes, list[bytes]]:
    """Contents of the chunks of a PNG file, by type."""
    chunks: dict[bytes, list[bytes]] = {}
    start = 8
    while start + 12 <= len(data):
        (length,) = struct.unpack(">I", data[start : start + 4])
        kind = data[start + 4 : start + 8]
        chunks.setdefault(kind, []).append(data[start + 8 : start + 8 + length])
        start += 12 + length
    if b"IDAT" not in chunks:
        raise ValueError("PNG without pixels")
    return chunks


def _png_chunk(kind: bytes, content: bytes) -> bytes:
    """One chunk of a PNG file."""
    checksum = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)


def _without_alpha(path: Path, image: np.ndarray) -> np.ndarray:
    """``[H, W, C]`` with C of 1 or 3, of a type a light field may have."""
    if image.ndim == 2:
        image = image[..., None]
    if image.ndim != 3 or image.shape[2] > 4:
        raise InputError(f"{path}: has shape {list(image.shape)}; save it as one grey or RGB image")
    image = image[..., : {1: 1, 2: 1, 3: 3, 4: 3}[image.shape[2]]]
    if np.issubdtype(image.dtype, np.floating):
        return image.astype(np.float32)
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: has {image.dtype} pixels; save it with 8 or 16 bits per channel")
    return image
