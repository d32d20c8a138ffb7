"""Semi-global aggregation of a cost volume along straight paths."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.kernels.reductions import min_leading


def semi_global(
    costs: Float[Array, "d h w"],
    guide: Float[Array, "h w"],
    *,
    small_penalty: Float[Array, ""] | float,
    large_penalty: Float[Array, ""] | float,
    guide_scale: float,
) -> Float[Array, "d h w"]:
    """Aggregate a cost volume along eight straight paths into each pixel.

    Semi-global matching (Hirschmueller, Stereo Processing by Semiglobal Matching and Mutual
    Information, TPAMI 2008). The cost of candidate k at pixel p along a path is its own cost plus
    the least cost of a transition from the previous pixel q::

        L(p, k) = C(p, k) - min L(q)
                + min(L(q, k), L(q, k - 1) + P1, L(q, k + 1) + P1, min L(q) + P2)

    with ``P2 = max(P1, large_penalty * exp(-|guide(p) - guide(q)| / guide_scale))``: a depth edge
    is cheap where the guide has an edge. The result is the mean over the paths; its scale is that
    of costs accumulated over a neighbourhood. Time is O(d h w), memory that of a few volumes.

    Args:
        costs: ``[d, h, w]`` cost of each candidate, candidates in increasing order.
        guide: ``[h, w]`` image of the centre view.
        small_penalty: P1, penalty of a step to a neighbouring candidate (slanted surfaces).
        large_penalty: Upper bound of P2, the penalty of a larger step (depth edges).
        guide_scale: Difference of the guide that reduces P2 by a factor e.

    Returns:
        ``[d, h, w]`` aggregated costs.

    Example:
        >>> noisy = jnp.array([[0.0, 0.0, 0.3, 0.0, 0.0], [0.2, 0.2, 0.2, 0.2, 0.2]])[:, None]
        >>> smooth = semi_global(
        ...     noisy, jnp.zeros((1, 5)), small_penalty=0.5, large_penalty=1.0, guide_scale=0.1
        ... )
        >>> noisy.argmin(0)[0].tolist(), smooth.argmin(0)[0].tolist()
        ([0, 0, 1, 0, 0], [0, 0, 0, 0, 0])
    """
    step = partial(
        _advance,
        small=jnp.asarray(small_penalty, costs.dtype),
        large=jnp.asarray(large_penalty, costs.dtype),
        guide_scale=guide_scale,
    )
    by_row, by_column = jnp.moveaxis(costs, 0, 1), jnp.moveaxis(costs, 2, 0)

    def paths(along_rows: Callable) -> Array:
        down = along_rows(by_row, guide, step, (0, 1, -1))
        across = along_rows(by_column, guide.T, step, (0,))
        return jnp.moveaxis(down, 1, 0) + jnp.moveaxis(across, 0, 2)

    one_by_one, together = (partial(paths, each) for each in (_path_by_path, _all_paths))
    return jax.lax.platform_dependent(cpu=one_by_one, default=together) / 8


def _path_by_path(
    costs: Float[Array, "y d x"],
    guide: Float[Array, "y x"],
    step: Callable[..., Array],
    slopes: tuple[int, ...],
) -> Float[Array, "y d x"]:
    """Sum the path costs of both directions of each slope, one path after the other.

    A path moves one row and ``slope`` columns at each step. On a CPU this takes 0.7 of the time of
    :func:`_all_paths`.
    """

    def along_rows(slope: int, reverse: bool) -> Array:
        def row(before, here):
            path = step(*before, *here, slope=slope)
            return (path, here[1]), path

        start = (jnp.zeros_like(costs[0]), guide[-1] if reverse else guide[0])
        return jax.lax.scan(row, start, (costs, guide), reverse=reverse)[1]

    total = jnp.zeros_like(costs)
    for slope in slopes:
        for reverse in (False, True):
            total = total + along_rows(slope, reverse)
    return total


def _all_paths(
    costs: Float[Array, "y d x"],
    guide: Float[Array, "y x"],
    step: Callable[..., Array],
    slopes: tuple[int, ...],
) -> Float[Array, "y d x"]:
    """Compute the same row by row for all paths: few large steps, which suit a GPU."""

    def both_directions(rows: Array) -> Array:
        return jnp.stack([rows, rows[::-1]], axis=1)

    def row(before: tuple[Array, Array], here: tuple[Array, Array]):
        paths, guide_before = before
        cost, guide_here = here
        moved = [
            jax.vmap(partial(step, slope=slope))(path, guide_before, cost, guide_here)
            for path, slope in zip(paths, slopes, strict=True)
        ]
        paths = jnp.stack(moved)
        return (paths, guide_here), paths.sum(0)

    guides = both_directions(guide)
    start = jnp.zeros((len(slopes), 2, *costs.shape[1:]), costs.dtype)
    sums = jax.lax.scan(row, (start, guides[0]), (both_directions(costs), guides))[1]
    return sums[:, 0] + sums[::-1, 1]


def _advance(
    path: Float[Array, "d x"],
    guide_before: Float[Array, " x"],
    cost: Float[Array, "d x"],
    guide_here: Float[Array, " x"],
    *,
    slope: int,
    small: Array,
    large: Array,
    guide_scale: float,
) -> Float[Array, "d x"]:
    """Compute the path costs of a row from those of the row before."""
    outside = jnp.full((1, cost.shape[1]), jnp.inf, cost.dtype)
    if slope:
        # A path that enters through the side of the image starts there with zero cost.
        entry = 0 if slope > 0 else -1
        path = jnp.roll(path, slope, axis=1).at[:, entry].set(0.0)
        guide_before = jnp.roll(guide_before, slope)
    edge_penalty = jnp.maximum(
        small, large * jnp.exp(-jnp.abs(guide_here - guide_before) / guide_scale)
    )
    lowest = min_leading(path)[None]
    neighbour = jnp.minimum(
        jnp.concatenate([path[1:], outside]), jnp.concatenate([outside, path[:-1]])
    )
    arrival = jnp.minimum(jnp.minimum(path, neighbour + small), lowest + edge_penalty[None])
    return cost + arrival - lowest
