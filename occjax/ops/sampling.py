"""Bilinear sampling of a view at the positions that a disparity points to.

Two samplings differ at the image border; the published network uses both:

* :func:`shift` applies one displacement to the whole image; taps outside the image read zero;
* :func:`warp` applies one displacement per pixel; the border is replicated (default) or zero.

Coordinates are computed in at least float32, whatever the type of the image. Both functions are
differentiable with respect to the image, the disparity and the offset. The bilinear interpolant is
piecewise linear with kinks at whole pixels; there, the derivative is the one towards larger
coordinates.

:func:`as_images` and :func:`as_coordinates` convert the arguments of all operations, so that NumPy
arrays, numbers and lists are accepted as well as JAX arrays.
"""

from __future__ import annotations

from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from occjax.errors import InputError, check_one_of
from occjax.kernels.bilinear import base_and_fraction, project_pixels, whole_and_fraction
from occjax.kernels.reductions import accumulation_dtype
from occjax.lightfield import LightField, view_offsets

Border = Literal["replicate", "zero"]
"""What :func:`warp` reads outside the image."""

Rows = tuple[int | Int[Array, ""], int]
"""First row (may be traced) and number of rows (static) of a strip of the centre view."""


def shift(
    image: Float[Array, "h w c"],
    disparity: Float[Array, ""] | float,
    offset: Float[Array | np.ndarray, "2"],
    *,
    rows: Rows | None = None,
) -> Float[Array, "r w c"]:
    """Register a view with the centre view, for one disparity of the whole image.

    ``result[y, x] = image(y - disparity * offset[0], x - disparity * offset[1])``, bilinear; taps
    outside the image read zero. The gradient of the image is computed by matrix products along its
    rows and columns, so one non-finite value in the incoming gradient affects its whole channel.
    The gradient of the disparity is zero where all taps lie outside the image.

    Args:
        image: ``[h, w, c]`` view or feature map.
        disparity: ``[]`` pixels per view step.
        offset: ``[2]`` offset ``(row, column)`` of the view from the centre view, in view steps.
        rows: First row and number of rows r of the result. They may extend one row beyond the
            image on each side. All h rows by default.

    Returns:
        ``[r, w, c]`` shifted image.

    Raises:
        InputError: If the image is not floating point, the disparity is not one number, the offset
            is not a row and a column, or the rows are not those of the image.

    Example:
        >>> ramp = jnp.arange(4.0)[None, :, None]
        >>> shift(ramp, jnp.float32(0.5), jnp.array([0.0, -1.0]))[0, :, 0].tolist()
        [0.5, 1.5, 2.5, 1.5]
    """
    image = as_images(image, "h w c", "image")
    first, count = as_rows(rows, image.shape[0])
    disparity, offset = as_coordinates(disparity, as_offsets(offset, ()))
    if disparity.ndim:
        raise InputError(
            f"disparity must be one number, not {list(disparity.shape)}; use warp for a map"
        )
    return _displaced(image, -disparity * offset, jnp.asarray(first, jnp.int32), count)


@partial(jax.custom_jvp, nondiff_argnums=(3,))
def _displaced(
    image: Float[Array, "h w c"], displacement: Float[Array, "2"], first: Int[Array, ""], count: int
) -> Float[Array, "r w c"]:
    """Return ``image(first + y + displacement[0], x + displacement[1])``, zero outside."""
    taps, fraction = _taps(image, displacement, first, count)
    return _interpolate(_interpolate(taps, fraction[0], 0), fraction[1], 1)


@partial(_displaced.defjvp, symbolic_zeros=True)
def _displaced_jvp(count: int, primals, tangents):
    """Compute the derivative in the image by matrix products of its rows and columns.

    The derivative of the gather would transpose to a scatter-add, which is slow, most of all on a
    GPU. Matrix products transpose to matrix products.
    """
    image, displacement, first = primals
    image_tangent, displacement_tangent, _ = tangents
    h, w, _ = image.shape
    taps, fraction = _taps(image, displacement, first, count)
    between_rows = _interpolate(taps, fraction[0], 0)
    value = _interpolate(between_rows, fraction[1], 1)
    change = jnp.zeros_like(value)
    if not isinstance(image_tangent, SymbolicZero):
        whole, _ = whole_and_fraction(displacement, (h, w), image.dtype)
        rows = _interpolation_matrix(whole[0] + first, fraction[0], count, h)
        columns = _interpolation_matrix(whole[1], fraction[1], w, w)
        change = jnp.einsum("yi,ijc->yjc", rows, image_tangent, precision="highest")
        change = jnp.einsum("xj,yjc->yxc", columns, change, precision="highest")
    if not isinstance(displacement_tangent, SymbolicZero):
        down = _interpolate(taps[1:] - taps[:-1], fraction[1], 1)
        right = between_rows[:, 1:] - between_rows[:, :-1]
        for slope, step in zip((down, right), displacement_tangent, strict=True):
            change = change + slope * step.astype(image.dtype)
    return value, change


def _taps(
    image: Float[Array, "h w c"], displacement: Float[Array, "2"], first: Int[Array, ""], count: int
) -> tuple[Float[Array, "i j c"], Float[Array, "2"]]:
    """Return the pixels between which a displaced image lies, and the fraction between them."""
    h, w, _ = image.shape
    (row, column), fraction = whole_and_fraction(displacement, (h, w), image.dtype)
    # One row and column of zeros on each side stand for all pixels outside the image.
    rows = jnp.clip(row + first + jnp.arange(count + 1, dtype=jnp.int32), -1, h) + 1
    columns = jnp.clip(column + jnp.arange(w + 1, dtype=jnp.int32), -1, w) + 1
    return jnp.pad(image, ((1, 1), (1, 1), (0, 0)))[rows][:, columns], fraction


def _interpolate(taps: Array, fraction: Float[Array, ""], axis: int) -> Array:
    """Interpolate between neighbouring taps along an axis, which becomes shorter by one."""
    size = taps.shape[axis]
    lower = jax.lax.slice_in_dim(taps, 0, size - 1, axis=axis)
    upper = jax.lax.slice_in_dim(taps, 1, size, axis=axis)
    return lower * (jnp.ones((), taps.dtype) - fraction) + upper * fraction


def _interpolation_matrix(
    first: Int[Array, ""], fraction: Float[Array, ""], count: int, size: int
) -> Float[Array, "count size"]:
    """Return the matrix that interpolates along an axis; each row has at most two entries."""
    position = jnp.arange(size, dtype=jnp.int32)[None, :]
    lower = first + jnp.arange(count, dtype=jnp.int32)[:, None]
    zero, one = jnp.zeros((), fraction.dtype), jnp.ones((), fraction.dtype)
    return jnp.where(position == lower, one - fraction, zero) + jnp.where(
        position == lower + 1, fraction, zero
    )


def warp(
    image: Float[Array, "h w c"],
    disparity: Float[Array, "r w"],
    offset: Float[Array | np.ndarray, "2"],
    *,
    border: Border = "replicate",
    first_row: int | Int[Array, ""] = 0,
) -> Float[Array, "r w c"]:
    """Warp a view to the centre view by a disparity map of the centre view (eq. 4).

    ``result[y, x] = image(y - d[y, x] * offset[0], x - d[y, x] * offset[1])``, bilinear. Beyond a
    replicated border the gradient of the disparity is zero. At whole pixels, including zero
    disparity, it is the full derivative towards larger coordinates.

    Args:
        image: ``[h, w, c]`` view or feature map.
        disparity: ``[r, w]`` of all or some rows of the centre view, pixels per view step.
        offset: ``[2]`` offset ``(row, column)`` of the view from the centre view, in view steps.
        border: ``"replicate"`` clamps the base tap to ``[0, size - 2]`` and the fraction to
            ``[0, 1]``, which repeats the border outwards; ``"zero"`` reads taps outside the image
            as zero, as :func:`shift` does.
        first_row: Row of the centre view at which ``disparity`` begins.

    Returns:
        ``[r, w, c]`` warped image.

    Raises:
        InputError: If the image is not floating point, the disparity does not fit it, the offset is
            not a row and a column, or the border is unknown.

    Example:
        >>> ramp = jnp.tile(jnp.arange(4.0)[None, :, None], (2, 1, 1))
        >>> warp(ramp, jnp.full((2, 4), 0.5), jnp.array([0.0, -1.0]))[0, :, 0].tolist()
        [0.5, 1.5, 2.5, 3.0]
    """
    check_one_of("border", border, Border)
    image = as_images(image, "h w c", "image")
    disparity, offset = as_coordinates(disparity, as_offsets(offset, ()))
    h, w, _ = image.shape
    if disparity.ndim != 2 or disparity.shape[0] > h or disparity.shape[1] != w:
        raise InputError(
            f"disparity must be [{h}, {w}] like the image, or some of its rows, "
            f"not {list(disparity.shape)}"
        )
    y, x = project_pixels(disparity, offset, first_row)
    if border == "zero":
        image = jnp.pad(image, ((1, 1), (1, 1), (0, 0)))
        y, x = y + 1.0, x + 1.0
    row, down = base_and_fraction(y, image.shape[0])
    column, right = base_and_fraction(x, image.shape[1])
    # The gradient of the image is summed in single precision: that is more exact than half, and
    # atomic additions on a GPU are far faster in 32 bits than in 16.
    values = image.astype(accumulation_dtype(image))
    down, right = (fraction.astype(values.dtype)[..., None] for fraction in (down, right))

    def between_columns(row):
        return values[row, column] * (1.0 - right) + values[row, column + 1] * right

    result = between_columns(row) * (1.0 - down) + between_columns(row + 1) * down
    return result.astype(image.dtype)


def as_images(images: ArrayLike, axes: str, name: str = "views") -> Array:
    """Return views or features as a floating-point JAX array with the expected axes.

    Integer images are refused. Bilinear weights would round to zero or one in their type, and sums
    of 8 bits would overflow.

    Args:
        images: Views or features as the user passed them.
        axes: The axes they must have, for instance ``"v u h w c"``.
        name: Name of the argument, for the message.

    Returns:
        The same values, of the same floating type.

    Raises:
        InputError: If they are not floating point or have other axes.
    """
    if isinstance(images, LightField):
        raise InputError(
            f"{name} must be an array, not a LightField; pass light_field.floating() or "
            "light_field.grey()"
        )
    images = jnp.asarray(images)
    if not jnp.issubdtype(images.dtype, jnp.floating):
        raise InputError(
            f"{name} must be floating point, not {images.dtype}; "
            "pass light_field.floating() or light_field.grey()"
        )
    if images.ndim != len(axes.split()):
        message = f"{name} must be [{', '.join(axes.split())}], not {list(images.shape)}"
        grey = axes.endswith("c") and images.ndim == len(axes.split()) - 1
        raise InputError(message + (f"; pass grey images as {name}[..., None]" if grey else ""))
    return images


def as_coordinates(*values: ArrayLike) -> tuple[Array, ...]:
    """Return disparities and offsets in one common type of at least float32.

    bfloat16 has too few bits for coordinates: at column 512 its steps are two pixels wide.
    """
    arrays = [jnp.asarray(value) for value in values]
    double = any(array.dtype == jnp.float64 for array in arrays)
    return tuple(array.astype(jnp.float64 if double else jnp.float32) for array in arrays)


def as_offsets(offsets: ArrayLike | None, grid: tuple[int, ...]) -> Float[Array, "*grid 2"]:
    """Return the offsets of the views as coordinates.

    Args:
        offsets: Offset ``(row, column)`` of each view, in view steps; None for a regular grid.
        grid: ``(V, U)``, number of view rows and view columns; ``()`` for the offset of one view.

    Raises:
        InputError: If there is not one offset for each view.
    """
    if offsets is None:
        return jnp.asarray(view_offsets(*grid))
    (offsets,) = as_coordinates(offsets)
    if offsets.shape != (*grid, 2):
        name = "offsets" if grid else "offset"
        raise InputError(f"{name} must be {[*grid, 2]}, not {list(offsets.shape)}")
    return offsets


def as_rows(rows: Rows | None, height: int) -> Rows:
    """Return the first row and the number of rows of a strip of an image.

    Args:
        rows: The strip as the user passed it; None for the whole image.
        height: Number of rows of the image.

    Raises:
        InputError: If they are not two numbers, or extend more than one row beyond the image. A
            traced first row has no value that could be checked.
    """
    if rows is None:
        return 0, height
    if not isinstance(rows, tuple | list) or len(rows) != 2:
        raise InputError(f"rows must be (first row, number of rows), not {rows!r}")
    first, count = rows
    known = -1 if isinstance(first, jax.core.Tracer) else int(first)
    if count < 1 or known < -1 or known + count > height + 1:
        raise InputError(
            f"rows are {count} from row {first}, but the image has {height} rows and one more may "
            "be computed on each side"
        )
    return first, count
