"""Images of one view: PNG, JPEG, TIFF, BMP, EXR and Radiance files with all their bits."""

from __future__ import annotations

import io
import re
import struct
import threading
from pathlib import Path

import imagecodecs
import numpy as np
import tifffile
from PIL import Image

from occjax.errors import InputError
from occjax.io.files import decoding
from occjax.io.hdr import HDR_SUFFIXES, read_exr
from occjax.io.limits import ReadLimits

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", *HDR_SUFFIXES)
"""Suffixes of the image files that are read, in lower case."""

UNSUPPORTED_SUFFIXES = (
    *(".webp", ".gif", ".avif", ".heic", ".heif", ".jp2"),
    *(".ppm", ".pgm", ".tga", ".dng"),
)
"""Suffixes of unsupported image files, for messages."""

PLENOPTIC_SUFFIXES = (".lfr", ".lfp", ".raw")
"""Suffixes of undecoded images of plenoptic cameras, for messages."""

PLENOPTIC_REMEDY = (
    "undecoded images of plenoptic cameras are not read; decode it with PlenoptiCam and pass its "
    "folder viewpoints_*px (pattern '{v}_{u}.png'), or with the Light Field Toolbox for MATLAB and "
    "pass its file *__Decoded.mat (key 'LF')"
)
"""End of the message on such a file: what to do with it."""

_PNG_CHANNELS = {2: 3, 4: 2, 6: 4}  # by the colour type in the header; others have one

_PILLOW_FORMATS = ("PNG", "JPEG", "TIFF", "BMP")  # others can start programs, such as EPS

_PILLOW_LIMIT = threading.Lock()
"""Held while Pillow's limit on the number of pixels, a global variable, is lifted."""


def read_image(path: str | Path) -> np.ndarray:
    """Read an image with all the bits that it stores.

    Args:
        path: PNG, JPEG, TIFF, BMP, EXR (needs the package OpenEXR) or Radiance (``.hdr``) file of
            any size. An alpha channel is dropped; a palette is replaced by its colours.

    Returns:
        ``[H, W, C]`` uint8, uint16 or (TIFF only) float32, C is 1 (grey) or 3 (RGB).

    Raises:
        InputError: If the file cannot be read, is not an image, or is damaged.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "grey.png"
        >>> Image.fromarray(np.uint8([[0, 128]])).save(path)
        >>> read_image(path).tolist()
        [[[0], [128]]]
    """
    path = Path(path)
    with decoding(path, "an image") as file:
        data = file.read()
        image = read_exr(path, len(data)) if data.startswith(b"v/1\x01") else _decode(path, data)
    if image.ndim == 2:
        image = image[..., None]
    if image.ndim != 3 or image.shape[2] > 4:
        raise InputError(f"{path}: has shape {list(image.shape)}; save it as one grey or RGB image")
    image = image[..., : 1 if image.shape[2] < 3 else 3]
    image = image.astype(image.dtype.newbyteorder("="), copy=False)
    if np.issubdtype(image.dtype, np.floating):
        return image.astype(np.float32)
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: has {image.dtype} pixels; save it with 8 or 16 bits per channel")
    return image


def _decode(path: Path, data: bytes) -> np.ndarray:
    """Decode an image by the library that keeps all its bits, after a check of its size."""
    limits = ReadLimits.current()
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        width, height, bits, colour = struct.unpack_from(">IIBB", data, 16)
        pixel_bytes = max(1, _PNG_CHANNELS.get(colour, 1) * bits // 8)
        limits.check_image(path, (height, width), pixel_bytes=pixel_bytes, file_bytes=len(data))
        return imagecodecs.png_decode(data)  # Pillow reads 16-bit colour as 8 bits
    if data.startswith((b"#?RADIANCE", b"#?RGBE")):
        header = data[:4096]  # must state the size
        sizes = re.search(rb"\n[-+]Y (\d{1,9}) [-+]X (\d{1,9})\n", header)
        if sizes is None:
            raise ValueError("it has no size")
        limits.check_image(
            path, (int(sizes[1]), int(sizes[2])), pixel_bytes=12, file_bytes=len(data)
        )
        return imagecodecs.rgbe_decode(data)
    if data.startswith((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")):
        return _decode_tiff(path, data)
    return _decode_with_pillow(path, data)


def _decode_tiff(path: Path, data: bytes) -> np.ndarray:
    """Decode a TIFF file with tifffile; palettes, JPEG and other colour spaces with Pillow."""
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        page = file.pages.first
        plain = page.photometric in (tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.RGB)
        if plain and page.compression != tifffile.COMPRESSION.JPEG:
            size = (page.imagelength, page.imagewidth)
            values = page.samplesperpixel * page.imagedepth
            pixel_bytes = values * (page.dtype.itemsize if page.dtype else 1)
            limits = ReadLimits.current()
            limits.check_image(path, size, pixel_bytes=pixel_bytes, file_bytes=len(data))
            image = page.asarray()
            planes_first = page.planarconfig == 2 and image.ndim == 3
            return np.moveaxis(image, 0, -1) if planes_first else image
        if page.bitspersample != 8:
            raise ValueError("it is neither grey nor RGB")
        return _decode_with_pillow(path, data)


def _decode_with_pillow(path: Path, data: bytes) -> np.ndarray:
    """Decode an image of 8 bits per channel, or a grey one of 16."""
    with open_with_pillow(path, data) as image:
        if image.mode in ("L", "LA", "RGB", "RGBA"):
            return np.asarray(image)
        if image.mode.startswith("I;16"):
            return np.asarray(image).astype(np.uint16)
        return np.asarray(image.convert("L" if image.mode == "1" else "RGB"))


def open_with_pillow(path: Path, data: bytes) -> Image.Image:
    """Return an image of a known format, not yet decoded, after a check of its size.

    Args:
        path: File, for messages.
        data: Its bytes.

    Raises:
        InputError: If the image is too large.
    """
    with _PILLOW_LIMIT:  # the limit is checked when the file is opened; mosaics exceed it
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            image = Image.open(io.BytesIO(data), formats=_PILLOW_FORMATS)
        finally:
            Image.MAX_IMAGE_PIXELS = limit
    pixel_bytes, limits = len(image.getbands()), ReadLimits.current()
    limits.check_image(path, image.size[::-1], pixel_bytes=pixel_bytes, file_bytes=len(data))
    return image
