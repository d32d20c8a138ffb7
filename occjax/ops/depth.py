"""Disparity, metric depth and points in space, with the camera of a scene's ``parameters.cfg``.

Camera coordinates are those of 3D viewers: x to the right, y up, z to the viewer, so that the scene
has negative z; metres, from the centre camera.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.lightfield import Calibration


def depth_from_disparity(
    disparity: Float[Array, "h w"], calibration: Calibration
) -> Float[Array, "h w"]:
    """Metric depth of a disparity map of the whole centre view.

    ``1 / depth = d / (f * b) + 1 / focus`` with the focal length ``f`` in pixels and the baseline
    ``b``, which is the formula of the HCI 4D benchmark
    (:meth:`occjax.lightfield.Calibration.inverse_depth`).

    Args:
        disparity: ``[h, w]`` pixels per view step, of either sign.
        calibration: Camera parameters. Not an array: static for ``jax.jit``.

    Returns:
        ``[h, w]`` metres along the optical axis. Infinite, with a gradient of zero, where the
        disparity is at or below that of infinitely distant points; NaN where it is NaN.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=4.0)
        >>> depth_from_disparity(jnp.array([[0.0, -5.0]]), camera).tolist()
        [[4.0, inf]]
    """
    disparity = jnp.asarray(disparity)
    height, width = disparity.shape
    inverse = calibration.inverse_depth(disparity, (height, width))
    distant = inverse <= 0.0
    return jnp.where(distant, jnp.inf, 1.0 / jnp.where(distant, 1.0, inverse))


def disparity_from_depth(
    depth: Float[Array, "h w"], calibration: Calibration
) -> Float[Array, "h w"]:
    """Disparity of a map of metric depth: the inverse of :func:`depth_from_disparity`.

    Args:
        depth: ``[h, w]`` metres along the optical axis.
        calibration: Camera parameters. Not an array: static for ``jax.jit``.

    Returns:
        ``[h, w]`` pixels per view step: finite for infinite depth, NaN, with a gradient of zero,
        where the depth is not positive.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> disparity_from_depth(jnp.array([[7.0, 0.0]]), camera).tolist()
        [[0.0, nan]]
    """
    depth = jnp.asarray(depth)
    possible = depth > 0.0
    height, width = depth.shape
    disparity = calibration.disparity(jnp.where(possible, depth, 1.0), (height, width))
    return jnp.where(possible, disparity, jnp.nan)


def back_project(depth: Float[Array, "h w"], calibration: Calibration) -> Float[Array, "h w 3"]:
    """Where the pixels of the centre view are in space, by the pinhole model.

    ``(X, Y, Z) = depth * ((x - x0) / f, (y0 - y) / f, -1)`` with the focal length ``f`` in pixels
    and ``(x0, y0)`` the middle of the image.

    Args:
        depth: ``[h, w]`` metres along the optical axis.
        calibration: Camera parameters. Not an array: static for ``jax.jit``.

    Returns:
        ``[h, w, 3]`` metres: x to the right, y up, z to the viewer. NaN, with a gradient of zero,
        where the depth is not positive and finite.

    Example:
        >>> camera = Calibration(50.0, 50.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> back_project(jnp.array([[4.0, 4.0]]), camera)[0, 1].tolist()
        [1.0, 0.0, -4.0]
    """
    depth = jnp.asarray(depth)
    height, width = depth.shape
    focal_length = calibration.focal_length_pixels((height, width))
    right = (jnp.arange(width, dtype=depth.dtype) - 0.5 * (width - 1)) / focal_length
    up = (0.5 * (height - 1) - jnp.arange(height, dtype=depth.dtype)) / focal_length
    right, up = jnp.meshgrid(right, up)
    directions = jnp.stack([right, up, -jnp.ones_like(depth)], axis=-1)
    somewhere = ((depth > 0.0) & jnp.isfinite(depth))[..., None]
    points = jnp.where(somewhere, depth[..., None], 1.0) * directions
    return jnp.where(somewhere, points, jnp.nan)
