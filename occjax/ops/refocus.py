"""Refocusing: the mean of the views over the aperture, registered for the disparity in focus.

The mean is that of the stored values; for photographs, which are gamma-encoded, pass linear values
if the brightness of highlights matters.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from occjax.errors import InputError
from occjax.kernels.bilinear import project_pixels
from occjax.kernels.reductions import accumulation_dtype
from occjax.lightfield import centre_index, project
from occjax.ops.occlusion import occlusion_weights
from occjax.ops.sampling import as_coordinates, as_images, as_offsets, shift, warp


def aperture_weights(
    offsets: Float[Array | np.ndarray, "v u 2"], diameter: Float[Array, ""] | float
) -> Float[Array, "v u"]:
    """Compute the weight of each view in a round aperture around the centre view.

    ``clip((diameter + 1) / 2 - |offset|, 0, 1)``: one inside, with a rim one view step wide, so
    that the image changes smoothly with the diameter. A diameter of 0 leaves only the centre view.

    Args:
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in view
            steps, as from :func:`occjax.ops.view_offsets`.
        diameter: Diameter of the aperture, in view steps.

    Returns:
        ``[v, u]`` weights in [0, 1].

    Raises:
        InputError: If the offsets are not ``[v, u, 2]``, or the diameter is negative, unless it is
            traced.

    Example:
        >>> from occjax.ops import view_offsets
        >>> aperture_weights(view_offsets(1, 5), 2.0).tolist()
        [[0.0, 0.5, 1.0, 0.5, 0.0]]
    """
    if not isinstance(diameter, jax.core.Tracer) and not float(diameter) >= 0.0:
        raise InputError(f"diameter must be at least 0, not {diameter}")
    offsets, diameter = as_coordinates(offsets, diameter)
    if offsets.ndim != 3 or offsets.shape[-1] != 2:
        raise InputError(f"offsets must be [v, u, 2], not {list(offsets.shape)}")
    squared = jnp.square(offsets).sum(-1)
    # The derivative of the root is infinite at zero, the offset of the centre view.
    away = squared > 0.0
    distance = jnp.where(away, jnp.sqrt(jnp.where(away, squared, 1.0)), 0.0)
    return jnp.clip(0.5 * (diameter + 1.0) - distance, 0.0, 1.0)


def refocus(
    views: Float[Array, "v u h w c"],
    disparity: Float[Array, ""] | float,
    *,
    offsets: Float[Array | np.ndarray, "v u 2"] | None = None,
    weights: Float[Array | np.ndarray, "v u"] | None = None,
) -> Float[Array, "h w c"]:
    """Compute the image that a camera with the aperture of the grid takes, focused at a disparity.

    ``sum_k w_k shift(view_k, d) / sum_k w_k shift(1, d)``: each view is registered with the centre
    view for the disparity (:func:`occjax.ops.shift`), and the mean is over the views that see the
    pixel, so that the border is not darkened. Points at that disparity are sharp. A point at a
    disparity that is larger by ``e`` is blurred over ``e`` pixels per view step of the aperture.

    Differentiable with respect to views, disparity, offsets and weights. One view after the other
    is shifted, so the memory is that of the views.

    Args:
        views: ``[v, u, h, w, c]`` images, floating point.
        disparity: ``[]`` disparity in focus, pixels per view step.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in view
            steps; a regular grid by default.
        weights: ``[v, u]`` non-negative weight of each view, for instance from
            :func:`aperture_weights`, and 0 for views that are missing; equal by default.

    Returns:
        ``[h, w, c]`` image; zero where no view of positive weight sees the pixel.

    Raises:
        InputError: If the views are not floating point, the disparity is not one number, or the
            shapes do not fit together.

    Example:
        >>> columns = jnp.sin(jnp.arange(32.0))
        >>> wall = jnp.stack([jnp.roll(columns, -2 * u) for u in (-1, 0, 1)])
        >>> views = jnp.broadcast_to(wall[None, :, None, :, None], (1, 3, 4, 32, 1))
        >>> sharp = refocus(views, 2.0)
        >>> bool(jnp.allclose(sharp[:, 2:-2], views[0, 1, :, 2:-2]))
        True
    """
    views = as_images(views, "v u h w c")
    (disparity,) = as_coordinates(disparity)
    h, w, _ = views.shape[2:]
    rows, columns = (jnp.arange(size, dtype=disparity.dtype)[:, None] for size in (h, w))

    def add(view, offset):
        y, x = project(rows, columns.T, disparity, offset)
        return shift(view, disparity, offset), _coverage(y, h) * _coverage(x, w)

    return _mean(add, views, offsets, weights)


def all_in_focus(
    views: Float[Array, "v u h w c"],
    disparity: Float[Array, "h w"],
    *,
    offsets: Float[Array | np.ndarray, "v u 2"] | None = None,
    weights: Float[Array | np.ndarray, "v u"] | None = None,
) -> Float[Array, "h w c"]:
    """Compute an image that is sharp everywhere, from all views: the centre view with less noise.

    Each view is warped to the centre view by the disparity map (:func:`occjax.ops.warp`). The mean
    is weighted by how well a view agrees with the centre view (:func:`occjax.ops.occlusion_weights`
    of the difference summed over the channels), so that views in which a point is occluded do not
    contribute. Differentiable like :func:`refocus`.

    Args:
        views: ``[v, u, h, w, c]`` images in [0, 1], floating point.
        disparity: ``[h, w]`` disparity of the centre view, pixels per view step.
        offsets: ``[v, u, 2]`` offsets of the views, see :func:`refocus`.
        weights: ``[v, u]`` weights of the views, see :func:`refocus`.

    Returns:
        ``[h, w, c]`` image.

    Raises:
        InputError: If the views are not floating point or the shapes do not fit together.

    Example:
        >>> noise = jax.random.normal(jax.random.key(0), (5, 5, 16, 16, 1))
        >>> image = all_in_focus(0.5 + 0.01 * noise, jnp.zeros((16, 16)))
        >>> float(image.std()) < 0.003
        True
    """
    views = as_images(views, "v u h w c")
    (disparity,) = as_coordinates(disparity)
    h, w, _ = views.shape[2:]
    if disparity.shape != (h, w):
        raise InputError(
            f"disparity must be [{h}, {w}] like the views, not {list(disparity.shape)}"
        )
    centre = views[centre_index(views.shape[:2])]

    def add(view, offset):
        y, x = project_pixels(disparity, offset)
        warped = warp(view, disparity, offset)
        difference = jnp.clip(jnp.abs(warped - centre).sum(-1), 0.0, 1.0)
        agreement = occlusion_weights(difference).astype(disparity.dtype)
        seen = agreement * _coverage(y, h) * _coverage(x, w)
        return warped * seen[..., None].astype(warped.dtype), seen

    return _mean(add, views, offsets, weights)


def _mean(
    add: Callable[[Array, Array], tuple[Array, Array]],
    views: Float[Array, "v u h w c"],
    offsets: ArrayLike | None,
    weights: ArrayLike | None,
) -> Float[Array, "h w c"]:
    """Return the weighted mean over the views of the images and weights that ``add`` returns."""
    v, u, h, w, c = views.shape
    offsets = as_offsets(offsets, (v, u))
    weights = jnp.ones((v, u), offsets.dtype) if weights is None else jnp.asarray(weights)
    if weights.shape != (v, u):
        raise InputError(f"weights must be {[v, u]}, not {list(weights.shape)}")
    dtype = accumulation_dtype(views)

    def step(sums, inputs):
        view, offset, weight = inputs
        image, seen = add(view, offset)
        weight, seen = weight.astype(dtype), seen.astype(dtype)
        return (sums[0] + weight * image.astype(dtype), sums[1] + weight * seen), None

    start = jnp.zeros((h, w, c), dtype), jnp.zeros((h, w), dtype)
    flat = (views.reshape(v * u, h, w, c), offsets.reshape(-1, 2), weights.reshape(-1))
    (total, weight), _ = jax.lax.scan(step, start, flat)
    seen = (weight > 0.0)[..., None]
    mean = jnp.where(seen, total, 0.0) / jnp.where(seen, weight[..., None], 1.0)
    return mean.astype(views.dtype)


def _coverage(position: Float[Array, "..."], size: int) -> Float[Array, "..."]:
    """Return the part of a bilinear sample that lies within an image: ``shift`` of ones."""
    return jnp.clip(jnp.minimum(position + 1.0, size - position), 0.0, 1.0)
