"""Images of high dynamic range: OpenEXR files and tone mapping."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from occjax.errors import InputError, warn
from occjax.io.config import ReadingConfig
from occjax.io.limits import ReadLimits

HDR_SUFFIXES = (".exr", ".hdr")
"""Suffixes of images of high dynamic range, in lower case."""


def read_exr(path: Path, file_bytes: int) -> np.ndarray:
    """Read the first part of an OpenEXR file.

    Args:
        path: File with the channels R, G, B, or with one channel other than A; scanlines or tiles.
        file_bytes: Its size, with which the size of the image is compared.

    Returns:
        ``[H, W, C]`` float32, C of 3 or 1.

    Raises:
        InputError: If the package OpenEXR is not installed, the image is too large, or it has other
            channels.
    """
    try:
        import OpenEXR
    except ImportError as error:
        raise InputError(
            f"{path}: reading EXR needs OpenEXR; run pip install 'occjax[exr]'"
        ) from error
    with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
        first, last = file.header()["dataWindow"]
        values = len(file.header()["channels"])
    width, height = (int(end) - int(start) + 1 for start, end in zip(first, last, strict=True))
    limits = ReadLimits.current()
    limits.check_image(path, (height, width), pixel_bytes=4 * values, file_bytes=file_bytes)
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {name: np.array(c.pixels, np.float32) for name, c in file.channels().items()}
    names = [name for name in channels if name != "A"]
    if {"R", "G", "B"} <= set(names):
        names = ["R", "G", "B"]
    elif len(names) != 1:
        raise InputError(
            f"{path}: has the channels {', '.join(channels)}; save it with R, G and B, or with one"
        )
    return np.stack([channels[name] for name in names], axis=-1)


def tone_mapped(path: Path, views: np.ndarray) -> np.ndarray:
    r"""Return views as integers or in [0, 1]; others are mapped to [0, 1] by a mu-law.

    The mu-law ``log(1 + mu x / white) / log(1 + mu)`` is the same for all views. It keeps
    differences in dark and bright parts.

    Args:
        path: File or folder of the views, for the message.
        views: ``[V, U, H, W, C]`` of any type.

    Returns:
        The views as they are if they are integers, in [0, 1], or not finite (refused by a later
        check); as integers if they are whole numbers of 8 or 16 bits; else mapped views, float32.

    Warns:
        UserWarning: If the views are changed.

    Example:
        >>> import warnings
        >>> with warnings.catch_warnings(action="ignore"):
        ...     mapped = tone_mapped(Path("a.exr"), np.array([0.0, 0.5, 8.0]))
        >>> mapped.astype(float).round(2).tolist()
        [0.0, 0.68, 1.0]
    """
    if not np.issubdtype(views.dtype, np.floating) or not np.isfinite(views).all():
        return views
    low, high = float(views.min()), float(views.max())
    if low >= 0.0 and high <= 1.0:
        return views
    # Some programs store images of integers as floating point.
    if low >= 0.0 and high < 2**16 and np.array_equal(views, np.rint(views)):
        bits = 8 if high < 2**8 else 16
        warn(
            f"{path}: pixels are whole numbers up to {high:g} in floating point, read as {bits} "
            "bits; map them to [0, 1] yourself if that is wrong"
        )
        return views.astype(np.uint8 if bits == 8 else np.uint16)
    if high <= 0.0:
        raise InputError(f"{path}: no pixel is positive; save the views with values above 0")
    white = float(np.percentile(views, ReadingConfig().white_percentile)) or high
    warn(
        f"{path}: pixels reach from {low:.4g} to {high:.4g}; they are tone-mapped by a mu-law with "
        f"white at {white:.4g}; map them to [0, 1] yourself if you need another mapping"
    )
    unit = np.clip(views / np.float32(white), 0.0, 1.0)
    mu = 5000.0  # compression, as in Kalantari and Ramamoorthi (2017), equation 5
    return (np.log1p(mu * unit) / np.log1p(mu)).astype(np.float32)
