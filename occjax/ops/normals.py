"""Which way the surfaces of a scene face."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


def surface_normals(points: Float[Array, "h w 3"], *, edge: float = 3.0) -> Float[Array, "h w 3"]:
    """Unit normals of the surfaces that an image shows, facing the viewer.

    The normal is the cross product of a difference of points along the row and one up the column.
    Each is central, between the neighbours on both sides, unless one of them is more than ``edge``
    times as far away in space as the other: then a surface ends between the pixel and that
    neighbour, and the difference is that to the nearer one. So it is where a neighbour is missing.
    Planes are exact at any slant. A surface one pixel wide has no neighbour of its own, and takes
    the direction of what is around it.

    Args:
        points: ``[h, w, 3]`` place of each pixel in space, as from
            :func:`occjax.ops.back_project`; NaN or infinite where there is none.
        edge: Ratio of the distances to the two neighbours, at least 1; infinite for central
            differences even across the ends of surfaces.

    Returns:
        ``[h, w, 3]`` unit vectors in the coordinates of the points: (0, 0, 1) faces the viewer.
        NaN, with a gradient of zero, where a pixel or both its neighbours in a direction have no
        place.

    Example:
        >>> right, up = jnp.meshgrid(jnp.arange(3.0), -jnp.arange(3.0))
        >>> slope = jnp.stack([right, up, -right], axis=-1)  # recedes to the right
        >>> surface_normals(slope)[1, 1].round(3).tolist()
        [0.7070000171661377, 0.0, 0.7070000171661377]
    """
    points = jnp.asarray(points)
    placed = jnp.isfinite(points).all(axis=-1)
    points = jnp.where(placed[..., None], points, 0.0)
    rightwards, has_row = _difference(points, placed, 1, edge)
    downwards, has_column = _difference(points, placed, 0, edge)
    normal = jnp.cross(rightwards, -downwards)
    squared = jnp.sum(jnp.square(normal), axis=-1, keepdims=True)
    known = (placed & has_row & has_column)[..., None] & (squared > 0.0)
    length = jnp.sqrt(jnp.where(known, squared, 1.0))
    return jnp.where(known, normal / length, jnp.nan)


def _difference(
    points: Float[Array, "h w 3"], placed: Bool[Array, "h w"], axis: int, edge: float
) -> tuple[Float[Array, "h w 3"], Bool[Array, "h w"]]:
    """Difference along an axis on the side or sides where the surface goes on; is there any?"""
    step = jnp.diff(points, axis=axis)
    size = points.shape[axis] - 1
    both = jnp.take(placed, jnp.arange(size), axis) & jnp.take(
        placed, jnp.arange(1, size + 1), axis
    )
    squared = jnp.where(both, jnp.sum(jnp.square(step), axis=-1), jnp.inf)

    def padded(array, before, value):
        widths = [(0, 0)] * array.ndim
        widths[axis] = (before, 1 - before)
        return jnp.pad(array, widths, constant_values=value)

    before, after = padded(squared, 1, jnp.inf), padded(squared, 0, jnp.inf)
    use_before = jnp.isfinite(before) & (before <= edge**2 * after)
    use_after = jnp.isfinite(after) & (after <= edge**2 * before)
    difference = jnp.where(use_before[..., None], padded(step, 1, 0.0), 0.0)
    difference += jnp.where(use_after[..., None], padded(step, 0, 0.0), 0.0)
    return difference, use_before | use_after
