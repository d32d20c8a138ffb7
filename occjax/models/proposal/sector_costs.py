"""Costs of disparity maps by sector of the aperture.

An occluder hides a point from the views on one side. Therefore the differences between the views
and the centre view are averaged in eight sectors of the aperture, and a comparison of the sectors
can see past an occluding edge. The size of the result depends neither on the number of views nor on
their arrangement.

:func:`occjax.models.proposal.costs.sector_sums` computes the same for one disparity of the whole
image.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from occjax.kernels.bilinear import inside_view, pack_pairs, warp_packed_pair, warp_plane
from occjax.models.proposal.aperture import SECTORS, other_views, sum_over_views
from occjax.models.proposal.filters import box_filter
from occjax.ops.sampling import as_coordinates, as_images

MIN_WEIGHT = 1e-3
"""Weight, in views, of the aperture's mean in each sector. It guards against a division by zero:
a sector without views has that mean."""


class SectorCosts(NamedTuple):
    """Sums of costs over the views of each sector.

    Attributes:
        sums: ``[8, d, h, w]`` sums of the costs; for several measures with an axis before them.
        weights: ``[8, d, h, w]`` number of views, or an array that broadcasts to it.
    """

    sums: Float[Array, "*m 8 d h w"]
    weights: Float[Array, "8 _ _ _"]


class SectorMeans(NamedTuple):
    """Mean costs over parts of the aperture.

    Attributes:
        sectors: ``[8, d, h, w]`` mean of each sector; a sector without views has the mean of the
            whole aperture.
        aperture: ``[d, h, w]`` mean of the whole aperture.
        best_half: ``[d, h, w]`` mean of the half of the aperture that agrees best.
    """

    sectors: Float[Array, "8 d h w"]
    aperture: Float[Array, "d h w"]
    best_half: Float[Array, "d h w"]


def geman_mcclure(residual: Float[Array, "*shape"], tolerance: float) -> Float[Array, "*shape"]:
    """Compute the robust cost ``r^2 / (r^2 + tolerance^2)`` of a residual.

    Geman and McClure, Statistical Methods for Tomographic Image Reconstruction, 1987.

    Args:
        residual: Differences of any shape.
        tolerance: Difference at which the cost is one half.

    Returns:
        Costs in [0, 1) of the same shape.

    Example:
        >>> costs = geman_mcclure(jnp.array([0.0, 0.25, -0.75]), 0.25)
        >>> [round(float(cost), 2) for cost in costs]
        [0.0, 0.5, 0.9]
    """
    square = jnp.square(residual)
    return square / (square + tolerance**2)


def refined_sector_costs(
    features: Float[Array, "v u h w c"],
    disparities: Float[Array, "d h w"],
    *,
    penalties: Callable[[list[Float[Array, "h w"]]], Sequence[Float[Array, "h w"]]],
    offsets: Float[Array, "v u 2"] | None = None,
) -> SectorCosts:
    """Warp the views by each disparity map and sum their costs in each sector.

    A view that is read outside its image is not counted.

    Args:
        features: ``[v, u, h, w, c]`` views or features of them. Two half-precision channels
            (float16) are read together, which takes half of the time on a CPU but has no derivative
            with respect to them.
        disparities: ``[d, h, w]`` disparity maps of the centre view, pixels per view step.
        penalties: Function from the differences of a view's features from those of the centre view
            to one or several cost maps ``[h, w]``.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        Sums ``[m, 8, d, h, w]`` of the m measures and weights ``[8, d, h, w]``.

    Raises:
        InputError: If there is only one view, or for integer features.

    Example:
        >>> features, maps = jnp.zeros((3, 3, 8, 8, 1)), jnp.zeros((5, 8, 8))
        >>> costs = refined_sector_costs(
        ...     features, maps, penalties=lambda differences: [jnp.abs(differences[0])]
        ... )
        >>> costs.sums.shape, float(costs.weights[:, 0, 4, 4].sum())
        ((1, 8, 5, 8, 8), 8.0)
    """
    sums, weights = _summed_costs([features], disparities, penalties, offsets, by_sector=True)
    return SectorCosts(sums, weights)


def refined_costs(
    features: Sequence[Float[Array, "v u h w _"]],
    disparities: Float[Array, "d h w"],
    *,
    penalties: Callable[[list[Float[Array, "h w"]]], Sequence[Float[Array, "h w"]]],
    offsets: Float[Array, "v u 2"] | None = None,
) -> tuple[Float[Array, "m d h w"], Float[Array, "d h w"]]:
    """Warp the views by each disparity map and sum their costs over the whole aperture.

    Args:
        features: Features of the views, in one or several arrays ``[v, u, h, w, c]``.
        disparities: See :func:`refined_sector_costs`.
        penalties: The same, with the differences of all features.
        offsets: The same.

    Returns:
        Sums ``[m, d, h, w]`` of the m measures, and ``[d, h, w]`` the number of views.

    Example:
        >>> features, maps = jnp.zeros((3, 3, 8, 8, 1)), jnp.zeros((5, 8, 8))
        >>> sums, count = refined_costs(
        ...     [features], maps, penalties=lambda differences: [jnp.abs(differences[0])]
        ... )
        >>> sums.shape, float(count[0, 4, 4])
        ((1, 5, 8, 8), 8.0)
    """
    sums, count = _summed_costs(features, disparities, penalties, offsets, by_sector=False)
    return sums[:, 0], count[0]


def _summed_costs(
    features: Sequence[Array],
    disparities: Array,
    penalties: Callable,
    offsets: Array | None,
    *,
    by_sector: bool,
) -> tuple[Float[Array, "m s d h w"], Float[Array, "s d h w"]]:
    """Sum the costs of the views of each sector, or of all views as one sector."""
    features = [as_images(each, "v u h w c", "features") for each in features]
    (disparities,) = as_coordinates(disparities)
    others = other_views(features[0].shape[:2], offsets).by_sector()
    flat = [each.reshape(-1, *each.shape[2:]) for each in features]
    readers = [_reader(images) for images in flat]
    centre = [
        plane.astype(jnp.float32) if plane.dtype == jnp.float16 else plane
        for images in flat
        for plane in jnp.moveaxis(images[others.centre], -1, 0)
    ]

    def view_costs(view):
        index, offset, present = view
        read_view = [reader(index) for reader in readers]

        def costs_of_map(disparity):
            visible = (present & inside_view(disparity, offset)).astype(centre[0].dtype)
            warped = [plane for read in read_view for plane in read(disparity, offset)]
            differences = [plane - here for plane, here in zip(warped, centre, strict=True)]
            return *(visible * cost for cost in penalties(differences)), visible

        return jax.vmap(costs_of_map)(disparities)

    measures = len(jax.eval_shape(penalties, centre))
    # One array per measure: with one array for all, XLA would compute the warps once per measure.
    zero = (jnp.zeros(disparities.shape, centre[0].dtype),) * (measures + 1)
    views = others.indices, others.offset, others.present
    *sums, weights = sum_over_views(view_costs, views, zero, others.sector if by_sector else None)
    return jnp.stack(sums), weights


def _reader(images: Float[Array, "n h w c"]) -> Callable:
    """Return a function that takes a view and returns one that warps its channels."""
    if images.dtype == jnp.float16 and images.shape[-1] == 2:
        pairs = pack_pairs(images)
        return lambda index: partial(warp_packed_pair, pairs[index])
    planes = jnp.moveaxis(images, -1, 1)

    def reader(index):
        view = planes[index]
        return lambda disparity, offset: [warp_plane(plane, disparity, offset) for plane in view]

    return reader


def sector_means(costs: SectorCosts) -> SectorMeans:
    """Compute the mean cost in each sector, in the whole aperture and in its best half.

    Args:
        costs: Sums of one measure.

    Returns:
        The means. The best half is chosen by means over 3x3 pixels, since single pixels would let
        noise choose.

    Example:
        >>> costs = SectorCosts(jnp.ones((8, 5, 6, 7)), jnp.full((8, 1, 1, 1), 2.0))
        >>> [means.shape for means in sector_means(costs)]
        [(8, 5, 6, 7), (5, 6, 7), (5, 6, 7)]
    """
    # Unrolled over the sectors: XLA computes all means in one pass over the sums.
    sums, weights = list(costs.sums), list(costs.weights)
    mean = sum(sums) / jnp.maximum(sum(weights), MIN_WEIGHT)
    sectors = [
        (sector_sum + MIN_WEIGHT * mean) / (sector_weight + MIN_WEIGHT)
        for sector_sum, sector_weight in zip(sums, weights, strict=True)
    ]

    def better(best: Float[Array, "d h w"], first: Int[Array, ""]):
        # Both sectors at the edge of a half belong to it.
        members = [(first + step) % SECTORS for step in range(SECTORS // 2 + 1)]
        total, weight = (sum(part[sector] for sector in members) for part in costs)
        half = (total + MIN_WEIGHT * mean) / (weight + MIN_WEIGHT)
        return jnp.minimum(best, box_filter(half, 1)), None

    # A loop in Python would be compiled once per half.
    best, _ = jax.lax.scan(better, jnp.full_like(mean, jnp.inf), jnp.arange(SECTORS))
    return SectorMeans(jnp.stack(sectors), mean, best)
