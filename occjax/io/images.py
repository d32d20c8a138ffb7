"""Images of one view: PNG, JPEG, TIFF, BMP, EXR and Radiance files with all their bits."""

from __future__ import annotations

import io
import threading
from pathlib import Path

import imagecodecs
import numpy as np
import tifffile
from PIL import Image

from occjax.errors import InputError
from occjax.io.files import decoding
from occjax.io.hdr import HDR_SUFFIXES, read_exr

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

_TIFF_BLACK, _TIFF_RGB = 1, 2  # values of the tag PhotometricInterpretation
_TIFF_JPEG = 7  # value of the tag Compression

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
    with decoding(path, "an image"):
        data = path.read_bytes()
        image = read_exr(path) if data.startswith(b"v/1\x01") else _decode(data)
    if image.ndim == 2:
        image = image[..., None]
    if image.ndim != 3 or image.shape[2] > 4:
        raise InputError(f"{path}: has shape {list(image.shape)}; save it as one grey or RGB image")
    image = image[..., : 1 if image.shape[2] < 3 else 3]
    if np.issubdtype(image.dtype, np.floating):
        return image.astype(np.float32)
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: has {image.dtype} pixels; save it with 8 or 16 bits per channel")
    return image


def _decode(data: bytes) -> np.ndarray:
    """Decode an image by the library that keeps all its bits."""
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return imagecodecs.png_decode(data)  # Pillow reads 16-bit colour as 8 bits
    if data.startswith((b"#?RADIANCE", b"#?RGBE")):
        return imagecodecs.rgbe_decode(data)
    if data.startswith((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")):
        return _decode_tiff(data)
    return _decode_with_pillow(data)


def _decode_tiff(data: bytes) -> np.ndarray:
    """Decode a TIFF file with tifffile; palettes, JPEG and other colour spaces with Pillow."""
    with tifffile.TiffFile(io.BytesIO(data)) as file:
        page = file.pages.first
        plain = page.photometric in (_TIFF_BLACK, _TIFF_RGB)
        if plain and page.compression != _TIFF_JPEG:
            image = page.asarray()
            planes_first = page.planarconfig == 2 and image.ndim == 3
            return np.moveaxis(image, 0, -1) if planes_first else image
        if page.bitspersample != 8:
            raise ValueError("it is neither grey nor RGB")
        return _decode_with_pillow(data)


def _decode_with_pillow(data: bytes) -> np.ndarray:
    """Decode an image of 8 bits per channel, or a grey one of 16."""
    with _PILLOW_LIMIT:  # the limit is checked when the file is opened; mosaics exceed it
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            opened = Image.open(io.BytesIO(data))
        finally:
            Image.MAX_IMAGE_PIXELS = limit
    with opened as image:
        if image.mode in ("L", "LA", "RGB", "RGBA"):
            return np.asarray(image)
        if image.mode.startswith("I;16"):
            return np.asarray(image).astype(np.uint16)
        return np.asarray(image.convert("L" if image.mode == "1" else "RGB"))
