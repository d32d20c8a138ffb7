"""Where the views lie around the centre view: the aperture, its sectors, the nearest views."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from occjax.errors import InputError
from occjax.ops.geometry import view_offsets
from occjax.ops.sampling import as_coordinates

SECTORS = 8
"""An occluder hides a point from views on one side together; so sides are told apart."""

MOST_BESIDE = 4
"""In a grid four views are next to the centre view."""


class Around(NamedTuple):
    """The other views of a light field, one after the other.

    Attributes:
        centre: Number of the centre view among all of them, counted row by row.
        view: ``[n]`` number of each other view.
        sector: ``[n]`` sector of the aperture it lies in, see :func:`sector_of`.
        offset: ``[n, 2]`` offset ``(row, column)`` from the centre view, in view steps.
        present: ``[n]`` False for a view at the centre's own place, which agrees with it at any
            disparity.
    """

    centre: int
    view: Int[Array, " n"]
    sector: Int[Array, " n"]
    offset: Float[Array, "n 2"]
    present: Bool[Array, " n"]

    @property
    def numbers(self) -> Float[Array, " 8"]:
        """Number of views in each sector."""
        return jnp.zeros(SECTORS, jnp.float32).at[self.sector].add(self.present.astype(jnp.float32))


def sector_of(offsets: Float[Array, "*grid 2"]) -> Int[Array, "*grid"]:
    """Sector of the aperture in which each view lies: its direction in steps of 45 degrees.

    Args:
        offsets: ``[..., 2]`` offset ``(row, column)`` of each view from the centre view.

    Returns:
        ``[...]`` int32; 0 is towards larger columns, 2 towards larger rows. That of the centre view
        itself is 0.

    Example:
        >>> sector_of(view_offsets(3, 3)).tolist()
        [[5, 6, 7], [4, 0, 0], [3, 2, 1]]
    """
    (offsets,) = as_coordinates(offsets)
    angle = jnp.arctan2(offsets[..., 0], offsets[..., 1])
    return jnp.round(angle * (SECTORS / (2 * np.pi))).astype(jnp.int32) % SECTORS


def views_around(grid: tuple[int, ...], offsets: ArrayLike | None) -> Around:
    """The views beside the centre view ``(v // 2, u // 2)``.

    Args:
        grid: ``(v, u)``.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid if None.

    Returns:
        All views but the centre one.

    Raises:
        InputError: If there is no other view, or offsets are of another shape.
    """
    v, u = grid
    if v * u < 2:
        raise InputError("one view has no disparity: give a grid of at least 1x2 views")
    (offsets,) = as_coordinates(view_offsets(v, u) if offsets is None else offsets)
    if offsets.shape != (v, u, 2):
        raise InputError(f"offsets must be {[v, u, 2]}, not {list(offsets.shape)}")
    centre = (v // 2) * u + u // 2
    others = np.delete(np.arange(v * u, dtype=np.int32), centre)
    offsets = offsets.reshape(-1, 2)[others]
    present = jnp.any(offsets != 0.0, axis=-1)
    return Around(centre, jnp.asarray(others), sector_of(offsets), offsets, present)


def views_beside(around: Around) -> tuple[Int[Array, " k"], Float[Array, "k 2"]]:
    """The up to four views that are nearest to the centre view.

    Args:
        around: The views.

    Returns:
        ``[k]`` number of each view and ``[k, 2]`` its offset. If fewer than k are about as near as
        the nearest one, that one takes the places left.

    Example:
        >>> beside, offsets = views_beside(views_around((3, 3), None))
        >>> sorted(beside.tolist())
        [1, 3, 5, 7]
    """
    far = jnp.where(around.present, jnp.square(around.offset).sum(-1), jnp.inf)
    order = jnp.argsort(far)[:MOST_BESIDE]
    order = jnp.where(far[order] <= 1.5 * far[order[0]], order, order[0])
    return around.view[order], around.offset[order]
