"""Flips, rotations and crops of a light field together with its ground truth.

Views, offsets, disparity, visibility and valid pixels are transformed together, so that the
transformed disparity warps the transformed views onto the centre view. Flipping or rotating the
images alone would reverse or exchange the directions of the view offsets.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from occjax.data.samples import LightFieldSample
from occjax.errors import InputError
from occjax.kernels.bilinear import inside_view

Symmetry = Literal["transpose", "flip_rows", "flip_columns"]
"""``transpose`` exchanges rows and columns; ``flip_rows`` turns upside down; ``flip_columns``
mirrors left to right. Together they generate the eight symmetries of a square."""


def transform_images(images: Any, symmetry: Symmetry, axes: tuple[int, int] = (-2, -1)) -> Any:
    """Flip or transpose images.

    Args:
        images: NumPy or JAX array of at least two axes.
        symmetry: The transform.
        axes: The axes of rows and columns, by default the last two.

    Example:
        >>> transform_images(np.array([[1, 2], [3, 4]]), "flip_rows").tolist()
        [[3, 4], [1, 2]]
    """
    if symmetry == "transpose":
        return images.swapaxes(*axes)
    index = [slice(None)] * images.ndim
    index[axes[0] if symmetry == "flip_rows" else axes[1]] = slice(None, None, -1)
    return images[tuple(index)]


def transform_offsets(offsets: Any, symmetry: Symmetry) -> Any:
    """Flip or transpose view offsets.

    Args:
        offsets: ``[..., 2]`` NumPy or JAX array of offsets ``(row, column)``.
        symmetry: The transform.

    Returns:
        ``[..., 2]`` transformed offsets.

    Example:
        >>> transform_offsets(np.array([1, 2]), "flip_rows").tolist()
        [-1, 2]
    """
    if symmetry == "transpose":
        return offsets[..., ::-1]
    signs = np.array([-1, 1] if symmetry == "flip_rows" else [1, -1], offsets.dtype)
    return offsets * np.broadcast_to(signs, offsets.shape)


def transform_sample(sample: LightFieldSample, symmetry: Symmetry) -> LightFieldSample:
    """Flip or transpose a light field: pixels and views together.

    Views keep the order of a grid, from top to bottom and left to right. Where that would move the
    centre view (an even number of views along a flipped axis) or change the shape of the grid
    (transposing a grid that is not square, or a list of views), views keep their place in the
    array, and only their offsets change.

    Args:
        sample: One sample (no batch axis) of NumPy or JAX arrays.
        symmetry: The transform.

    Returns:
        The transformed sample, of the same kind of arrays.

    Example:
        >>> from occjax.data.samples import numpy_sample
        >>> from occjax.lightfield import view_offsets
        >>> images = np.arange(6, dtype=np.float32).reshape(3, 1, 2, 1)
        >>> sample = numpy_sample(images, view_offsets(3, 1), images[1, 0])
        >>> transform_sample(sample, "flip_rows").views[:, 0, :, 0].tolist()
        [[5.0, 4.0], [3.0, 2.0], [1.0, 0.0]]
    """
    v, u = sample.views.shape[:2]
    reorder = {"transpose": v == u, "flip_rows": v % 2 == 1, "flip_columns": u % 2 == 1}[symmetry]

    def transform_grid(values):
        return transform_images(values, symmetry, axes=(0, 1)) if reorder else values

    return LightFieldSample(
        views=transform_images(transform_grid(sample.views), symmetry),
        offsets=transform_offsets(transform_grid(sample.offsets), symmetry),
        disparity=transform_images(sample.disparity, symmetry),
        visibility=transform_images(transform_grid(sample.visibility), symmetry),
        valid=transform_images(sample.valid, symmetry),
    )


def crop(
    sample: LightFieldSample, corner: Int[Array, "2"], size: tuple[int, int]
) -> LightFieldSample:
    """Cut the same window out of every view.

    Args:
        sample: One sample (no batch axis).
        corner: ``[2]`` row and column of the first pixel of the window.
        size: ``(h, w)`` of the window, in pixels.

    Returns:
        The window of the sample. Points outside the window of a view are not visible in it; if the
        visibility is unknown (true everywhere), it stays so.

    Raises:
        InputError: If the window is larger than the views.
    """
    height, width = sample.disparity.shape
    if size[0] > height or size[1] > width:
        raise InputError(
            f"a window of {size[0]}x{size[1]} pixels needs views of at least that size, not "
            f"{height}x{width}; pass a smaller crop"
        )

    def cut(images):
        leading = images.shape[:-2]
        return jax.lax.dynamic_slice(images, (*(0,) * len(leading), *corner), (*leading, *size))

    disparity = cut(sample.disparity)
    unknown = jnp.all(sample.visibility)
    inside = jax.vmap(jax.vmap(partial(inside_view, disparity)))(sample.offsets)
    return LightFieldSample(
        views=cut(sample.views),
        offsets=sample.offsets,
        disparity=disparity,
        visibility=cut(sample.visibility) & (inside | unknown),
        valid=cut(sample.valid),
    )
