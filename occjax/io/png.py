"""Maps of values as 16-bit grey PNG files that store their scale.

``value = scale * code + offset`` for the codes 1 to 65534; code 0 is no value (NaN), code 65535 is
infinite. Scale and offset are chosen for each map and stored in the file as text, with the quantity
and its unit. A value is therefore read back with an error of at most half the scale.

======================  ==================================================
``occjax:quantity``     disparity or depth
``occjax:unit``         unit of ``scale`` and ``offset``, in words
``occjax:scale``        decimal number
``occjax:offset``       decimal number
``occjax:formula``      the formula above, for readers without occjax
======================  ==================================================
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.files import decoding
from occjax.io.images import open_with_pillow, read_image

NO_VALUE, INFINITE = 0, 65535
"""Codes of pixels without a value, and of infinite ones."""

LOWEST, HIGHEST = 1, 65534
"""Codes of the least and the greatest finite value of a map."""

FORMULA = f"value = scale * code + offset; code {NO_VALUE} is no value, code {INFINITE} is infinite"


def write_value_png(path: str | Path, values: np.ndarray, *, quantity: str, unit: str) -> float:
    """Write a map as a 16-bit PNG, atomically.

    Args:
        path: File to write; an existing file is replaced.
        values: ``[H, W]`` real numbers; NaN and infinity are kept, minus infinity becomes NaN.
        quantity: Quantity of the values, stored as text.
        unit: Unit of the values, stored as text.

    Returns:
        The greatest difference between a value and what is read back: half the scale.

    Raises:
        InputError: If the array is not one map, or the file cannot be written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "disparity.png"
        >>> values = np.array([[-1.5, 0.25, np.nan]])
        >>> precision = write_value_png(path, values, quantity="disparity", unit="pixels")
        >>> round(precision, 7)
        1.34e-05
        >>> read_value_png(path)[0].round(4).tolist()
        [[-1.5, 0.25, nan]]
    """
    if values.ndim != 2 or values.size == 0:
        raise InputError(f"{path}: a PNG of values holds [H, W], not {list(values.shape)}")
    values = np.asarray(values, np.float64)
    finite = np.isfinite(values)
    low = values[finite].min() if finite.any() else 0.0
    high = values[finite].max() if finite.any() else 0.0
    # Both ends are divided before they are subtracted, since high - low may overflow.
    scale = float(high / (HIGHEST - LOWEST) - low / (HIGHEST - LOWEST)) or 1.0
    offset = float(low) - LOWEST * scale
    codes = np.where(np.isposinf(values), INFINITE, NO_VALUE).astype(np.uint16)
    rounded = np.rint((values[finite] - offset) / scale)
    codes[finite] = np.clip(rounded, LOWEST, HIGHEST).astype(np.uint16)
    text = PngInfo()
    for key, content in (
        ("quantity", quantity),
        ("unit", unit),
        ("scale", repr(scale)),
        ("offset", repr(offset)),
        ("formula", FORMULA),
    ):
        text.add_text(f"occjax:{key}", content)
    with atomic_path(path) as temporary:
        Image.fromarray(codes).save(temporary, format="PNG", pnginfo=text)
    return 0.5 * scale if high > low else 0.0


def read_value_png(
    path: str | Path, *, scale: float | None = None, offset: float | None = None
) -> tuple[np.ndarray, str | None]:
    """Read a map from a grey PNG.

    Args:
        path: A file that :func:`write_value_png` wrote, or any grey PNG of 8 or 16 bits.
        scale: Value of one code, for a file that does not store it; all its codes are then values.
        offset: Value of code 0, for such a file; 0 by default.

    Returns:
        ``[H, W]`` float64 values, in the unit of the scale; and the quantity that the file states,
        or None.

    Raises:
        InputError: If the file cannot be read, is in colour, does not store its scale and none is
            given, or stores its scale and another one is given.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "kitti.png"
        >>> Image.fromarray(np.uint16([[256, 512]])).save(path)
        >>> read_value_png(path, scale=1 / 256)[0].tolist()
        [[1.0, 2.0]]
    """
    path = Path(path)
    codes = read_image(path)
    with decoding(path, "the text of a PNG") as file, open_with_pillow(path, file.read()) as image:
        text = {key: str(value) for key, value in getattr(image, "text", {}).items()}
    if codes.shape[2] != 1 or codes.dtype not in (np.uint8, np.uint16):
        raise InputError(
            f"{path}: a picture in colour, from which values cannot be recovered; convert the .pfm "
            "or .npy it was made from"
        )
    codes = codes[..., 0]
    if "occjax:scale" in text:
        if scale is not None or offset is not None:
            raise InputError(f"{path}: stores its own scale; pass no --scale and no --offset")
        return _decode(path, codes, text)
    if scale is None:
        bits = 8 * codes.dtype.itemsize
        raise InputError(
            f"{path}: a grey PNG of {bits} bits that does not store its scale; read it with the "
            "scale and offset of value = S * code + O (occjax convert --scale S --offset O)"
        )
    offset = 0.0 if offset is None else offset
    if not math.isfinite(HIGHEST * scale + offset) or scale == 0.0:
        raise InputError(f"scale {scale:g} and offset {offset:g} must be numbers, scale not zero")
    return scale * codes.astype(np.float64) + offset, None


def _decode(path: Path, codes: np.ndarray, text: dict[str, str]) -> tuple[np.ndarray, str | None]:
    """Return the values by the scale and offset that the file stores."""
    if codes.dtype != np.uint16:
        raise InputError(
            f"{path}: was written with 16 bits and now has 8, so another program changed its "
            "values; convert the .pfm or .npy again"
        )
    try:
        scale, offset = float(text["occjax:scale"]), float(text["occjax:offset"])
    except (KeyError, ValueError):
        scale, offset = math.nan, math.nan
    if not math.isfinite(HIGHEST * scale + offset):
        raise InputError(f"{path}: its scale or offset is damaged; write the file again")
    values = scale * codes.astype(np.float64) + offset
    values[codes == NO_VALUE] = np.nan
    values[codes == INFINITE] = np.inf
    return values, text.get("occjax:quantity")
