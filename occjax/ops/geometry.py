"""Metric depth, 3D points and surface normals from disparity and the camera's calibration.

Coordinates are those of the centre camera, in metres, with the axes of OpenGL: x to the right, y
up, z towards the viewer. The scene therefore has negative z.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from occjax.errors import InputError
from occjax.lightfield import Calibration


def depth_from_disparity(
    disparity: Float[Array, "h w"], calibration: Calibration
) -> Float[Array, "h w"]:
    """Compute metric depth from a disparity map of the whole centre view.

    ``1 / depth = d / (f * b) + 1 / focus`` with the focal length ``f`` in pixels and the baseline
    ``b``: the formula of the HCI 4D benchmark
    (:meth:`occjax.lightfield.Calibration.inverse_depth`). The depth is infinite, with a gradient of
    zero, where the disparity is at or below that of infinitely distant points.

    Args:
        disparity: ``[h, w]`` pixels per view step, of either sign.
        calibration: Camera parameters. Not an array: a static argument for ``jax.jit``.

    Returns:
        ``[h, w]`` metres along the optical axis; NaN where the disparity is NaN.

    Raises:
        InputError: If the map is not ``[h, w]`` or there is no calibration.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=4.0)
        >>> depth_from_disparity(jnp.array([[0.0, -5.0]]), camera).tolist()
        [[4.0, inf]]
    """
    disparity = _map_with_calibration(disparity, calibration, "disparity")
    height, width = disparity.shape
    inverse = calibration.inverse_depth(disparity, (height, width))
    distant = inverse <= 0.0
    return jnp.where(distant, jnp.inf, 1.0 / jnp.where(distant, 1.0, inverse))


def disparity_from_depth(
    depth: Float[Array, "h w"], calibration: Calibration
) -> Float[Array, "h w"]:
    """Compute disparity from a map of metric depth: the inverse of :func:`depth_from_disparity`.

    The gradient is zero where the depth is not positive.

    Args:
        depth: ``[h, w]`` metres along the optical axis; may be infinite.
        calibration: Camera parameters. Not an array: a static argument for ``jax.jit``.

    Returns:
        ``[h, w]`` pixels per view step: finite for infinite depth, NaN where the depth is not
        positive.

    Raises:
        InputError: If the map is not ``[h, w]`` or there is no calibration.

    Example:
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> disparity_from_depth(jnp.array([[7.0, 0.0]]), camera).tolist()
        [[0.0, nan]]
    """
    depth = _map_with_calibration(depth, calibration, "depth")
    possible = depth > 0.0
    height, width = depth.shape
    disparity = calibration.disparity(jnp.where(possible, depth, 1.0), (height, width))
    return jnp.where(possible, disparity, jnp.nan)


def back_project(depth: Float[Array, "h w"], calibration: Calibration) -> Float[Array, "h w 3"]:
    """Compute the 3D point of each pixel of the centre view, by the pinhole model.

    ``(X, Y, Z) = depth * ((x - x0) / f, (y0 - y) / f, -1)`` with the focal length ``f`` in pixels
    and ``(x0, y0)``, the principal point, in the middle of the image. The gradient is zero where
    the depth is not positive and finite.

    Args:
        depth: ``[h, w]`` metres along the optical axis.
        calibration: Camera parameters. Not an array: a static argument for ``jax.jit``.

    Returns:
        ``[h, w, 3]`` metres: x to the right, y up, z towards the viewer; NaN where the depth is not
        positive and finite.

    Raises:
        InputError: If the map is not ``[h, w]`` or there is no calibration.

    Example:
        >>> camera = Calibration(50.0, 50.0, baseline_mm=50.0, focus_distance_m=7.0)
        >>> back_project(jnp.array([[4.0, 4.0]]), camera)[0, 1].tolist()
        [1.0, 0.0, -4.0]
    """
    depth = _map_with_calibration(depth, calibration, "depth")
    height, width = depth.shape
    focal_length = calibration.focal_length_pixels((height, width))
    right = (jnp.arange(width, dtype=depth.dtype) - 0.5 * (width - 1)) / focal_length
    up = (0.5 * (height - 1) - jnp.arange(height, dtype=depth.dtype)) / focal_length
    right, up = jnp.meshgrid(right, up)
    directions = jnp.stack([right, up, -jnp.ones_like(depth)], axis=-1)
    valid = ((depth > 0.0) & jnp.isfinite(depth))[..., None]
    points = jnp.where(valid, depth[..., None], 1.0) * directions
    return jnp.where(valid, points, jnp.nan)


def surface_normals(points: Float[Array, "h w 3"], *, edge: float = 3.0) -> Float[Array, "h w 3"]:
    """Compute unit normals of the visible surfaces, facing the viewer.

    The normal is the cross product of a difference of points along the row and one up the column.
    Each difference is central, unless one neighbour is more than ``edge`` times as far away in
    space as the other. That is a depth edge, and the difference to the nearer neighbour is used.
    The same holds next to a missing point. Planes are exact at any slant. A structure one pixel
    wide has no neighbour on its own surface, so that its normal is that of its surroundings. The
    gradient is zero where the normal is NaN.

    Args:
        points: ``[h, w, 3]`` point of each pixel, as from :func:`occjax.ops.back_project`; NaN or
            infinite for missing points.
        edge: Largest ratio of the distances to the two neighbours for a central difference, at
            least 1. Infinity takes central differences across depth edges too.

    Returns:
        ``[h, w, 3]`` unit vectors in the coordinates of the points: (0, 0, 1) faces the viewer. NaN
        where a point, or both its neighbours in a direction, are missing.

    Raises:
        InputError: If the points are not ``[h, w, 3]``.

    Example:
        >>> right, up = jnp.meshgrid(jnp.arange(3.0), -jnp.arange(3.0))
        >>> slope = jnp.stack([right, up, -right], axis=-1)  # recedes to the right
        >>> surface_normals(slope)[1, 1].round(3).tolist()
        [0.7070000171661377, 0.0, 0.7070000171661377]
    """
    points = jnp.asarray(points)
    if points.ndim != 3 or points.shape[-1] != 3:
        raise InputError(
            f"points must be [h, w, 3], not {list(points.shape)}; pass those of back_project"
        )
    valid = jnp.isfinite(points).all(axis=-1)
    points = jnp.where(valid[..., None], points, 0.0)
    rightwards, has_row = _difference(points, valid, 1, edge)
    downwards, has_column = _difference(points, valid, 0, edge)
    normal = jnp.cross(rightwards, -downwards)
    squared = jnp.sum(jnp.square(normal), axis=-1, keepdims=True)
    known = (valid & has_row & has_column)[..., None] & (squared > 0.0)
    length = jnp.sqrt(jnp.where(known, squared, 1.0))
    return jnp.where(known, normal / length, jnp.nan)


def _map_with_calibration(values: ArrayLike, calibration: Calibration, name: str) -> Array:
    """Return a map ``[h, w]`` as an array, after a check of its axes and of its calibration."""
    values = jnp.asarray(values)
    if values.ndim != 2:
        raise InputError(f"{name} must be [h, w], not {list(values.shape)}")
    if not isinstance(calibration, Calibration):
        raise InputError(
            f"calibration must be a Calibration, not {calibration!r}; a light field has none if "
            "its files describe no camera"
        )
    return values


def _difference(
    points: Float[Array, "h w 3"], valid: Bool[Array, "h w"], axis: int, edge: float
) -> tuple[Float[Array, "h w 3"], Bool[Array, "h w"]]:
    """Return the difference along an axis, over the sides where the surface continues.

    It spans one or two pixels and is not divided by them: only its direction affects the normal.
    The second result is False where the surface continues on neither side.
    """
    step = jnp.diff(points, axis=axis)
    size = points.shape[axis] - 1
    both = jnp.take(valid, jnp.arange(size), axis) & jnp.take(valid, jnp.arange(1, size + 1), axis)
    squared = jnp.where(both, jnp.sum(jnp.square(step), axis=-1), jnp.inf)

    def padded(array, width_before, value):
        widths = [(0, 0)] * array.ndim
        widths[axis] = (width_before, 1 - width_before)
        return jnp.pad(array, widths, constant_values=value)

    before, after = padded(squared, 1, jnp.inf), padded(squared, 0, jnp.inf)
    use_before = jnp.isfinite(before) & (before <= edge**2 * after)
    use_after = jnp.isfinite(after) & (after <= edge**2 * before)
    difference = jnp.where(use_before[..., None], padded(step, 1, 0.0), 0.0)
    difference += jnp.where(use_after[..., None], padded(step, 0, 0.0), 0.0)
    return difference, use_before | use_after


def in_double(
    function: Callable[[Array, Calibration], Array], values: np.ndarray, calibration: Calibration
) -> np.ndarray:
    """Evaluate a function of a map and its camera in double precision.

    Depth depends on a difference of inverse depths, normals on differences of neighbouring points.
    In single precision, these differences of nearly equal numbers lose digits.

    Args:
        function: Function such as :func:`depth_from_disparity`; compiled once per camera and shape.
        values: ``[...]`` map.
        calibration: Camera parameters.

    Returns:
        The function's result as a float64 NumPy array, whatever JAX's default precision is.
    """
    with jax.enable_x64(True):
        compiled = jax.jit(function, static_argnums=1)
        return np.asarray(compiled(np.asarray(values, np.float64), calibration))
