"""Changes of a light field that keep it one: its symmetries, and the choice of a frame.

Each function takes one sample (no batch axis) and changes views, offsets, disparity, visibility and
valid pixels together, so that the result is as consistent as the sample was: the views, warped by
the new disparity, agree where the new visibility says so. A flip or turn of the pictures alone
would not be: the views would move the wrong way.

Flips and turns also take samples of NumPy arrays, which stay such.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from occjax.data.samples import Sample
from occjax.errors import InputError


def flip_rows(sample: Sample) -> Sample:
    """Turn the light field upside down: rows of pixels and rows of views.

    Views keep the order of a grid, from top to bottom. If their number of rows is even, that order
    would put another view in the centre: then views stay where they are, and only their offsets say
    where that is now.

    Args:
        sample: One sample.

    Returns:
        The flipped sample.

    Example:
        >>> from occjax.ops import view_offsets
        >>> images = jnp.arange(6.0).reshape(3, 1, 2, 1)
        >>> seen = images >= 0
        >>> sample = Sample(images, view_offsets(3, 1), images[1, 0], seen, seen[1, 0])
        >>> flip_rows(sample).views[:, 0, :, 0].tolist()
        [[5.0, 4.0], [3.0, 2.0], [1.0, 0.0]]
    """
    return _flip(sample, 0)


def flip_columns(sample: Sample) -> Sample:
    """Mirror the light field left to right: columns of pixels and columns of views.

    As :func:`flip_rows`, for columns.

    Args:
        sample: One sample.

    Returns:
        The flipped sample.
    """
    return _flip(sample, 1)


def transpose(sample: Sample) -> Sample:
    """Exchange rows and columns, of pixels and of views.

    The grid of the views is transposed if it is as high as wide; otherwise (a list of views has one
    row whatever their offsets) views stay in their order and their offsets say where they are.

    Args:
        sample: One sample.

    Returns:
        The transposed sample; ``[w, h]`` pixels.
    """
    v, u = sample.views.shape[:2]
    square = v == u

    def over(values, *, pixels=True):
        values = values.swapaxes(0, 1) if square else values
        return values.swapaxes(-1, -2) if pixels else values

    return Sample(
        views=over(sample.views),
        offsets=over(sample.offsets, pixels=False)[..., ::-1],
        disparity=sample.disparity.T,
        visibility=over(sample.visibility),
        valid=sample.valid.T,
    )


def rotate(sample: Sample, quarter_turns: int) -> Sample:
    """Turn the light field counterclockwise, pixels and views, as ``jnp.rot90`` turns an image.

    Args:
        sample: One sample.
        quarter_turns: Number of turns by 90 degrees.

    Returns:
        The turned sample.
    """
    for _ in range(quarter_turns % 4):
        sample = flip_rows(transpose(sample))
    return sample


def _flip(sample: Sample, axis: int) -> Sample:
    """Reverse one axis of pixels and the same axis of views."""
    backwards = slice(None, None, -1)
    rows_or_columns = (backwards,) if axis == 0 else (slice(None), backwards)
    pixels = (..., *rows_or_columns, *(slice(None),) * (1 - axis))
    odd = sample.views.shape[axis] % 2 == 1

    def over(values):
        return values[rows_or_columns] if odd else values

    direction = np.where(np.arange(2) == axis, -1.0, 1.0).astype(sample.offsets.dtype)
    return Sample(
        views=over(sample.views)[pixels],
        offsets=over(sample.offsets) * direction[None, None, :],
        disparity=sample.disparity[rows_or_columns],
        visibility=over(sample.visibility)[pixels],
        valid=sample.valid[rows_or_columns],
    )


def frame(
    sample: Sample,
    corner: Int[Array, "2"],
    size: tuple[int, int],
    *,
    stride: int | Int[Array, ""] = 1,
    shear: float | Float[Array, ""] = 0.0,
    interpolate: bool = True,
) -> Sample:
    """Cut a frame out of every view, of every pixel or every ``stride``-th, and refocus.

    Pixel ``(i, j)`` of the result is what the sample has, in the view at offset ``(t, s)``, at

    ``(corner + stride * ((i, j) + shear * (t, s)))``

    so that each view's frame is shifted in proportion to its offset: a shear of the light field,
    which moves the plane of zero disparity. Disparity becomes ``disparity / stride + shear``.

    All frames must lie within the views; what does not repeats the border, and then it is no
    observation: choose ``corner`` so that it does not happen, as
    :func:`occjax.data.augmentation.random_frame` does.

    Args:
        sample: One sample.
        corner: ``[2]`` row and column of the frame's first pixel in the centre view.
        size: ``(h, w)`` of the frame, in pixels of the result.
        stride: Pixels of the sample per pixel of the result.
        shear: Added to the disparity, in pixels of the result.
        interpolate: Whether positions between pixels are interpolated (Catmull-Rom cubic, which
            keeps more detail than linear). If not they are rounded, exact for whole ``shear`` and
            offsets only, and quicker.

    Returns:
        The sample in that frame. Points that a view's frame leaves out are not visible in it;
        where visibility is not known (true everywhere) it stays so.

    Raises:
        InputError: If the frame is larger than the views.
    """
    h, w = size
    height, width = sample.disparity.shape
    if h > height or w > width:
        raise InputError(
            f"a frame of {h}x{w} pixels needs views of that size, not {height}x{width}"
        )
    dtype = sample.views.dtype
    corner, step = jnp.asarray(corner, dtype), jnp.asarray(stride, dtype)
    shifts = jnp.asarray(shear, dtype) * sample.offsets
    rows = corner[0] + step * (jnp.arange(h, dtype=dtype)[None, None] + shifts[..., :1])
    columns = corner[1] + step * (jnp.arange(w, dtype=dtype)[None, None] + shifts[..., 1:])
    cut = _interpolated if interpolate else _nearest
    views = jax.vmap(jax.vmap(cut))(sample.views, rows, columns)

    row = (corner[0] + step * jnp.arange(h, dtype=dtype)).astype(jnp.int32)[:, None]
    column = (corner[1] + step * jnp.arange(w, dtype=dtype)).astype(jnp.int32)[None, :]
    disparity = sample.disparity[row, column] / step + jnp.asarray(shear, dtype)
    visibility = sample.visibility[:, :, row, column]
    known = ~jnp.all(sample.visibility)
    inside = within_frame(disparity, sample.offsets)
    return Sample(
        views=views,
        offsets=sample.offsets,
        disparity=disparity,
        visibility=visibility & (inside | ~known),
        valid=sample.valid[row, column],
    )


def within_frame(
    disparity: Float[Array, "h w"], offsets: Float[Array, "v u 2"]
) -> Bool[Array, "v u h w"]:
    """Whether what the centre view sees lies within the frame of each view.

    Args:
        disparity: ``[h, w]`` of the centre view, pixels per view step.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view.

    Returns:
        ``[v, u, h, w]`` true between the middles of the outermost pixels.

    Example:
        >>> offsets = jnp.array([[[0.0, -1.0], [0.0, 0.0], [0.0, 1.0]]])
        >>> within_frame(jnp.ones((1, 3)), offsets)[0, :, 0].tolist()
        [[True, True, False], [True, True, True], [False, True, True]]
    """
    h, w = disparity.shape
    d = disparity[None, None]
    offsets = offsets[..., None, None]
    y = jnp.arange(h, dtype=disparity.dtype)[None, None, :, None] - d * offsets[:, :, 0]
    x = jnp.arange(w, dtype=disparity.dtype)[None, None, None, :] - d * offsets[:, :, 1]
    return (y >= 0.0) & (y <= h - 1.0) & (x >= 0.0) & (x <= w - 1.0)


def _nearest(
    image: Float[Array, "height width"], rows: Float[Array, " h"], columns: Float[Array, " w"]
) -> Float[Array, "h w"]:
    """Pixels nearest to the crossings of rows and columns; the border is repeated."""
    height, width = image.shape
    row = jnp.clip(jnp.rint(rows).astype(jnp.int32), 0, height - 1)
    column = jnp.clip(jnp.rint(columns).astype(jnp.int32), 0, width - 1)
    return image[row[:, None], column[None, :]]


def _interpolated(
    image: Float[Array, "height width"], rows: Float[Array, " h"], columns: Float[Array, " w"]
) -> Float[Array, "h w"]:
    """Cubic interpolation at the crossings, as two products with banded matrices.

    Dense products take less time than gathering sixteen taps, on processors and on GPUs.
    """
    vertical = _cubic_matrix(rows, image.shape[0])
    horizontal = _cubic_matrix(columns, image.shape[1])
    cut = jnp.einsum("hH,HW,wW->hw", vertical, image, horizontal, precision="highest")
    return jnp.clip(cut, 0.0, 1.0)


def _cubic_matrix(positions: Float[Array, " n"], size: int) -> Float[Array, "n size"]:
    """Weights of the pixels of a line at positions on it (Catmull and Rom, 1974)."""
    base = jnp.floor(positions)
    f = positions - base
    weights = (
        ((-0.5 * f + 1.0) * f - 0.5) * f,
        (1.5 * f - 2.5) * f * f + 1.0,
        ((-1.5 * f + 2.0) * f + 0.5) * f,
        (0.5 * f - 0.5) * f * f,
    )
    pixels = jnp.arange(size, dtype=jnp.int32)[None, :]
    matrix = jnp.zeros((positions.shape[0], size), positions.dtype)
    for tap, weight in enumerate(weights):
        pixel = jnp.clip(base.astype(jnp.int32) + (tap - 1), 0, size - 1)
        matrix += jnp.where(pixels == pixel[:, None], weight[:, None], 0.0)
    return matrix
