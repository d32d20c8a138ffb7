"""The views around the centre view: their sector of the aperture, and the nearest views.

An occluder hides a point from the views on one side. Therefore the views are divided into eight
sectors by their direction from the centre view.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from occjax.errors import InputError
from occjax.lightfield import centre_index
from occjax.ops.sampling import as_coordinates, as_offsets

T = TypeVar("T")

SECTORS = 8
"""Number of sectors of the aperture, 45 degrees each."""


class OtherViews(NamedTuple):
    """All views but the centre view.

    Attributes:
        centre: Index of the centre view, counted row by row.
        indices: ``[n]`` index of each other view.
        sector: ``[n]`` sector of the aperture of each view (:func:`sector_of`).
        offset: ``[n, 2]`` offset ``(row, column)`` from the centre view, in view steps.
        present: ``[n]`` False for a view at the position of the centre view, which agrees with it
            at any disparity.
    """

    centre: int
    indices: Int[Array, " n"]
    sector: Int[Array, " n"]
    offset: Float[Array, "n 2"]
    present: Bool[Array, " n"]

    @property
    def sector_counts(self) -> Float[Array, " 8"]:
        """Number of views in each sector."""
        return jnp.zeros(SECTORS, jnp.float32).at[self.sector].add(self.present.astype(jnp.float32))

    def by_sector(self) -> OtherViews:
        """Return the views in the order of their sectors, as :func:`sum_over_views` needs them."""
        order = jnp.argsort(self.sector)
        return self._replace(
            **{name: getattr(self, name)[order] for name in self._fields if name != "centre"}
        )


def sector_of(offsets: Float[Array | np.ndarray, "*grid 2"]) -> Int[Array, "*grid"]:
    """Return the sector of the aperture of each view: its direction in steps of 45 degrees.

    Args:
        offsets: ``[..., 2]`` offset ``(row, column)`` of each view from the centre view.

    Returns:
        ``[...]`` int32; sector 0 points to larger columns, sector 2 to larger rows. The sector of
        the centre view is 0.

    Example:
        >>> from occjax.lightfield import view_offsets
        >>> sector_of(view_offsets(3, 3)).tolist()
        [[5, 6, 7], [4, 0, 0], [3, 2, 1]]
    """
    (offsets,) = as_coordinates(offsets)
    angle = jnp.arctan2(offsets[..., 0], offsets[..., 1])
    return jnp.round(angle * (SECTORS / (2 * np.pi))).astype(jnp.int32) % SECTORS


def other_views(grid: tuple[int, ...], offsets: ArrayLike | None) -> OtherViews:
    """Return index, sector and offset of all views but the centre view.

    Args:
        grid: ``(v, u)``, number of view rows and columns.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; None for
            a regular grid.

    Returns:
        The other views.

    Raises:
        InputError: If there is only one view, or the offsets do not fit the grid.
    """
    v, u = grid
    if v * u < 2:
        raise InputError("one view has no disparity; give a grid of at least 1x2 views")
    offsets = as_offsets(offsets, (v, u))
    centre = int(np.ravel_multi_index(centre_index((v, u)), (v, u)))
    others = np.delete(np.arange(v * u, dtype=np.int32), centre)
    offsets = offsets.reshape(-1, 2)[others]
    present = jnp.any(offsets != 0.0, axis=-1)
    return OtherViews(centre, jnp.asarray(others), sector_of(offsets), offsets, present)


def nearest_views(others: OtherViews) -> tuple[Int[Array, " k"], Float[Array, "k 2"]]:
    """Return the up to four views nearest to the centre view.

    Args:
        others: The views.

    Returns:
        ``[k]`` index of each view and ``[k, 2]`` its offset. If fewer than k views are about as
        near as the nearest one, the nearest one is repeated.

    Example:
        >>> indices, offsets = nearest_views(other_views((3, 3), None))
        >>> sorted(indices.tolist())
        [1, 3, 5, 7]
    """
    distance = jnp.where(others.present, jnp.square(others.offset).sum(-1), jnp.inf)
    # In a grid those above, below, left and right of the centre view.
    order = jnp.argsort(distance)[:4]
    order = jnp.where(distance[order] <= 1.5 * distance[order[0]], order, order[0])
    return others.indices[order], others.offset[order]


def sum_over_views(
    term: Callable[[Any], T], views: Any, zero: T, sector: Int[Array, " n"] | None
) -> T:
    """Sum terms of the views in each sector, one view after the other.

    On a CPU, XLA divides a running sum among the cores, but not an addition to one of eight maps.
    Therefore each view stores the running sum of its sector, which the next view of the sector
    replaces.

    Args:
        term: Function from the values of one view to one or several arrays.
        views: Arrays with a leading axis of the n views.
        zero: Arrays of zeros like those of ``term``.
        sector: ``[n]`` ascending sector of each view (:meth:`OtherViews.by_sector`); None sums all
            views, as if they were one sector.

    Returns:
        Arrays like ``zero``, with a leading axis of the 8 sectors, or of the one.

    Example:
        >>> sums = sum_over_views(lambda v: v, jnp.ones(3), jnp.zeros(()), jnp.array([0, 2, 2]))
        >>> sums.tolist()
        [1.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    if sector is None:
        total = jax.lax.scan(lambda sums, view: (_add(sums, term(view)), None), zero, views)[0]
        return jax.tree.map(lambda array: array[None], total)

    def add(carry: tuple[T, T], step: tuple[Array, Array, Any]) -> tuple[tuple[T, T], None]:
        running, sums = carry
        sector, starts_sector, view = step
        running = jax.tree.map(lambda array: jnp.where(starts_sector, 0.0, array), running)
        running = _add(running, term(view))
        stored = jax.tree.map(
            lambda all_sums, array: jax.lax.dynamic_update_index_in_dim(all_sums, array, sector, 0),
            sums,
            running,
        )
        return (running, stored), None

    empty = jax.tree.map(lambda array: jnp.stack([array] * SECTORS), zero)
    steps = sector, jnp.diff(sector, prepend=-1) > 0, views
    return jax.lax.scan(add, (zero, empty), steps)[0][1]


def _add(sums: T, terms: T) -> T:
    return jax.tree.map(jnp.add, sums, terms)
