"""Comparison of the disparity maps of different views of one light field.

The disparity of a point is the same in all views, so the map of a view predicts that of every
other view.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from occjax.errors import InputError
from occjax.kernels.bilinear import inside_view, warp_plane
from occjax.ops.sampling import as_coordinates, as_offsets


class CrossViewCounts(NamedTuple):
    """How many other views confirm or contradict each pixel of each view.

    Attributes:
        agreeing: ``[v, u, h, w]`` number of views with the same disparity at the point.
        conflicting: ``[v, u, h, w]`` number of views that see something behind the point, through
            it.
    """

    agreeing: Int[Array, "v u h w"]
    conflicting: Int[Array, "v u h w"]

    @property
    def consistency(self) -> Float[Array, "v u h w"]:
        """``[v, u, h, w]`` in [0, 1]: agreeing views among the agreeing and conflicting ones.

        It is 0 if no view agrees. Views from which the point is hidden do not count.
        """
        return self.agreeing / jnp.maximum(self.agreeing + self.conflicting, 1)


def cross_view_difference(
    disparity: Float[Array, "h w"],
    other: Float[Array, "h w"],
    offset: Float[Array | np.ndarray, "2"],
) -> Float[Array, "h w"]:
    """Compute the disparity that another view has at each point, minus that of this view.

    ``other(y - d * offset[0], x - d * offset[1]) - d``, bilinear. It is 0 where both views see the
    same point. It is positive where the other view sees something nearer, so that the point is
    hidden from it. It is negative where the other view sees something behind the point, which is
    impossible: one of the two maps is wrong. The gradient is that of :func:`occjax.ops.warp`, zero
    where the result is NaN.

    Args:
        disparity: ``[h, w]`` disparity map of a view, pixels per view step.
        other: ``[h, w]`` disparity map of the other view.
        offset: ``[2]`` offset ``(row, column)`` of the other view from this one, in view steps.

    Returns:
        ``[h, w]`` pixels per view step; NaN where the point is outside of the other image.

    Raises:
        InputError: If the maps are not two maps of the same size, or the offset is not a row and a
            column.

    Example:
        >>> centre = jnp.array([[0.0, 0.0, 1.0, 0.0, 0.0]])
        >>> right = jnp.array([[0.0, 1.0, 0.0, 0.0, 0.0]])  # the near point hides column 1
        >>> cross_view_difference(centre, right, jnp.array([0.0, 1.0])).tolist()
        [[0.0, 1.0, 0.0, 0.0, 0.0]]
    """
    disparity, other, offset = as_coordinates(disparity, other, as_offsets(offset, ()))
    if disparity.ndim != 2 or disparity.shape != other.shape:
        raise InputError(
            f"disparity and other must be [h, w] of the same size, not {list(disparity.shape)} and "
            f"{list(other.shape)}"
        )
    difference = warp_plane(other, disparity, offset) - disparity
    return jnp.where(inside_view(disparity, offset), difference, jnp.nan)


def cross_view_counts(
    disparity: Float[Array, "v u h w"],
    *,
    tolerance: Float[Array, ""] | float,
    radius: int = 2,
    offsets: Float[Array | np.ndarray, "v u 2"] | None = None,
    usable: Bool[Array | np.ndarray, "v u"] | None = None,
) -> CrossViewCounts:
    """Count the neighbouring views that confirm or contradict the disparity of each pixel.

    A view agrees if :func:`cross_view_difference` is at most ``tolerance`` and conflicts if it is
    below ``-tolerance``. Views from which the point is hidden, or whose image it leaves, do
    neither. The counts have no gradient.

    Args:
        disparity: ``[v, u, h, w]`` disparity map of each view, pixels per view step.
        tolerance: Largest difference of disparities that agree, pixels per view step.
        radius: Largest distance of views that are compared, in rows and in columns of the grid.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in view
            steps; a regular grid by default.
        usable: ``[v, u]`` False for views that have no map; all by default.

    Returns:
        Number of agreeing and of conflicting views.

    Raises:
        InputError: If the maps are not ``[v, u, h, w]``, offsets or mask do not fit, or radius or
            tolerance (unless it is traced) is negative.

    Example:
        >>> counts = cross_view_counts(jnp.zeros((3, 3, 4, 5)), tolerance=0.1, radius=1)
        >>> counts.agreeing[:, :, 0, 0].tolist()
        [[3, 5, 3], [5, 8, 5], [3, 5, 3]]
    """
    (disparity,) = as_coordinates(disparity)
    if disparity.ndim != 4:
        raise InputError(f"disparity must be [v, u, h, w], not {list(disparity.shape)}")
    v, u, h, w = disparity.shape
    for name, number in (("radius", radius), ("tolerance", tolerance)):
        if not isinstance(number, jax.core.Tracer) and not float(number) >= 0.0:
            raise InputError(f"{name} must be at least 0, not {number}")
    if usable is not None and jnp.shape(usable) != (v, u):
        raise InputError(f"usable must be [{v}, {u}], not {list(jnp.shape(usable))}")
    offsets = as_offsets(offsets, (v, u)).reshape(-1, 2)
    neighbours = jnp.asarray(_neighbours((v, u), radius))
    if usable is not None:
        # The index -1 stands for no view.
        present = jnp.asarray(usable).reshape(-1)
        neighbours = jnp.where(present[neighbours], neighbours, -1)
    maps = disparity.reshape(v * u, h, w)

    def of_view(view):
        index, others = view

        def add(counts, other):
            difference = cross_view_difference(
                maps[index], maps[other], offsets[other] - offsets[index]
            )
            found = jnp.stack([jnp.abs(difference) <= tolerance, difference < -tolerance])
            return counts + (found & (other >= 0)).astype(jnp.int32), None

        return jax.lax.scan(add, jnp.zeros((2, h, w), jnp.int32), others)[0]

    indices = jnp.arange(v * u, dtype=jnp.int32)
    counts = jax.lax.map(of_view, (indices, neighbours)).reshape(v, u, 2, h, w)
    return CrossViewCounts(counts[:, :, 0], counts[:, :, 1])


def _neighbours(grid: tuple[int, int], radius: int) -> np.ndarray:
    """Return ``[v u, n]`` indices of the views around each view; -1 where the grid has no view."""
    steps = np.indices((2 * radius + 1,) * 2).reshape(2, -1).T - radius
    steps = steps[np.any(steps != 0, axis=-1)]
    neighbours = np.indices(grid).reshape(2, -1).T[:, None] + steps
    inside = np.all((neighbours >= 0) & (neighbours < grid), axis=-1)
    return np.where(inside, neighbours[..., 0] * grid[1] + neighbours[..., 1], -1).astype(np.int32)
