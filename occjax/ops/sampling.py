"""Bilinear sampling of a view where a disparity points.

Two samplings, which differ at the image border; the published network uses both:

* :func:`shift`: one displacement for the whole image, taps outside it read zero;
* :func:`warp`: a displacement for each pixel; the border is replicated (default) or read as zero.

Coordinates are computed in at least float32, whatever the type of the image. Both are
differentiable in the image and in the disparity: the derivative with respect to disparity is that
of the bilinear interpolant, which is piecewise linear with kinks where a displacement is a whole
number of pixels (there the derivative is that of the segment towards larger coordinates).
"""

from __future__ import annotations

from typing import Literal, get_args

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from occjax.errors import InputError

Border = Literal["replicate", "zero"]

Rows = tuple[int | Int[Array, ""], int]
"""First row (may be traced) and number of rows (static) of a strip of the centre view."""


def shift(
    image: Float[Array, "h w c"],
    disparity: Float[Array, ""],
    offset: Float[Array, "2"],
    *,
    rows: Rows | None = None,
) -> Float[Array, "r w c"]:
    """Bring a view into register with the centre view, for one disparity of the whole image.

    ``result[y, x] = image(y - disparity * offset[0], x - disparity * offset[1])``, bilinear, where
    taps outside the image read zero.

    Args:
        image: ``[h, w, c]`` view or feature map.
        disparity: ``[]`` pixels per view step.
        offset: ``[2]`` offset ``(row, column)`` of the view from the centre view, in view steps.
        rows: First row and number of rows r of the result; all h by default.

    Returns:
        ``[r, w, c]`` shifted image.

    Example:
        >>> ramp = jnp.arange(4.0)[None, :, None]
        >>> shift(ramp, jnp.float32(0.5), jnp.array([0.0, -1.0]))[0, :, 0].tolist()
        [0.5, 1.5, 2.5, 1.5]
    """
    h, w, _ = image.shape
    first, count = (0, h) if rows is None else rows
    disparity, offset = as_coordinates(disparity, offset)
    displacement = -disparity * offset
    whole = jnp.floor(displacement)
    fraction = (displacement - whole).astype(image.dtype)
    # A shift by more than the image reads only zeros; clamping keeps it within integers.
    size = jnp.array([h, w], whole.dtype)
    row, column = jnp.clip(jax.lax.stop_gradient(whole), -size - 1.0, size).astype(jnp.int32)
    row = row + jnp.asarray(first, jnp.int32)
    # One row and column of zeros on each side stand for all that lies outside.
    rows_read = jnp.clip(row + jnp.arange(count + 1, dtype=jnp.int32), -1, h) + 1
    columns_read = jnp.clip(column + jnp.arange(w + 1, dtype=jnp.int32), -1, w) + 1
    taps = jnp.pad(image, ((1, 1), (1, 1), (0, 0)))[rows_read][:, columns_read]
    one = jnp.ones((), image.dtype)
    between_rows = taps[:-1] * (one - fraction[0]) + taps[1:] * fraction[0]
    left, right = between_rows[:, :-1], between_rows[:, 1:]
    return left * (one - fraction[1]) + right * fraction[1]


def warp(
    image: Float[Array, "h w c"],
    disparity: Float[Array, "r w"],
    offset: Float[Array, "2"],
    *,
    border: Border = "replicate",
    first_row: int | Int[Array, ""] = 0,
) -> Float[Array, "r w c"]:
    """Warp a view to the centre view by a disparity map of the centre view (eq. 4).

    ``result[y, x] = image(y - d[y, x] * offset[0], x - d[y, x] * offset[1])``, bilinear.

    Args:
        image: ``[h, w, c]`` view or feature map.
        disparity: ``[r, w]`` of all or some rows of the centre view, pixels per view step.
        offset: ``[2]`` offset ``(row, column)`` of the view from the centre view, in view steps.
        border: ``"replicate"`` clamps the base tap to ``[0, size - 2]`` and the fraction to
            ``[0, 1]``, so that the border is repeated outwards; ``"zero"`` reads taps outside the
            image as zero, as :func:`shift` does.
        first_row: Row of the centre view at which ``disparity`` begins.

    Returns:
        ``[r, w, c]`` warped image.

    Raises:
        InputError: If there is no such border.

    Example:
        >>> ramp = jnp.tile(jnp.arange(4.0)[None, :, None], (2, 1, 1))
        >>> warp(ramp, jnp.full((2, 4), 0.5), jnp.array([0.0, -1.0]))[0, :, 0].tolist()
        [0.5, 1.5, 2.5, 3.0]
    """
    if border not in get_args(Border):
        raise InputError(f'border: must be "replicate" or "zero", not "{border}"')
    disparity, offset = as_coordinates(disparity, offset)
    height, width = disparity.shape
    y = jnp.arange(height, dtype=disparity.dtype) + jnp.asarray(first_row, disparity.dtype)
    y = y[:, None] - disparity * offset[0]
    x = jnp.arange(width, dtype=disparity.dtype)[None, :] - disparity * offset[1]
    if border == "zero":
        image = jnp.pad(image, ((1, 1), (1, 1), (0, 0)))
        y, x = y + 1.0, x + 1.0
    row, row_fraction = _base_and_fraction(y, image.shape[0])
    column, column_fraction = _base_and_fraction(x, image.shape[1])
    row_fraction = row_fraction.astype(image.dtype)[..., None]
    column_fraction = column_fraction.astype(image.dtype)[..., None]
    one = jnp.ones((), image.dtype)

    def between_columns(row):
        left, right = image[row, column], image[row, column + 1]
        return left * (one - column_fraction) + right * column_fraction

    return between_columns(row) * (one - row_fraction) + between_columns(row + 1) * row_fraction


def as_coordinates(*values: Array) -> tuple[Array, ...]:
    """Disparities and offsets in one type of at least float32, whatever the promotion rules.

    Coordinates need more bits than bfloat16 has: at 512 pixels its steps are two pixels wide.
    """
    double = any(value.dtype == jnp.float64 for value in values)
    return tuple(value.astype(jnp.float64 if double else jnp.float32) for value in values)


def _base_and_fraction(coordinate: Array, size: int) -> tuple[Array, Array]:
    """Lower bilinear tap in [0, size - 2] and the weight of the upper one, in [0, 1].

    In an image one pixel wide the taps are -1 and 0, the same pixel.
    """
    base = jax.lax.stop_gradient(jnp.clip(jnp.floor(coordinate), 0.0, size - 2.0))
    fraction = coordinate - base
    # Not jnp.clip: at a bound it halves the derivative, and 0 is every whole number of pixels.
    fraction = jnp.where(fraction < 0.0, 0.0, jnp.where(fraction >= 1.0, 1.0, fraction))
    return base.astype(jnp.int32), fraction
