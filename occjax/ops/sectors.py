"""How well the views agree around a disparity map, by the side of the aperture they lie on.

An occluder hides a point from views on one side together. So the differences between the views and
the centre view are averaged in eight sectors of the aperture (by the direction of the view's
offset), and what compares the sectors can see past an occluding edge. The size of such a volume
depends neither on the number of views nor on their arrangement; a sector without views stands for
the average of the others.

:func:`refined_sector_costs` tells of some disparities for each pixel how well each fits,
:func:`sector_channels` what to look at of that. The same of one disparity for the whole image is
:func:`occjax.ops.matching.sector_sums`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.ops.aperture import SECTORS, views_around
from occjax.ops.filtering import box_filter
from occjax.ops.sampling import (
    as_coordinates,
    as_images,
    as_pairs,
    inside_view,
    warp_pair,
    warp_plane,
)

HALF_APERTURE = 5
"""Neighbouring sectors that make up one half of the aperture, its edges included."""


class SectorCosts(NamedTuple):
    """Sums over the views of each sector.

    Attributes:
        sums: ``[8, d, h, w]`` sum of what the views cost; of several measures, with an axis for
            them before.
        weights: ``[8, d, h, w]`` their number, or what broadcasts to that: ``[8, 1, 1, 1]``.
    """

    sums: Float[Array, "*m 8 d h w"]
    weights: Float[Array, "8 _ _ _"]


def geman_mcclure(residual: Float[Array, "*shape"], tolerance: float) -> Float[Array, "*shape"]:
    """Robust cost of a residual, ``r^2 / (r^2 + tolerance^2)``: one at most.

    Geman, McClure, Statistical Methods for Tomographic Image Reconstruction, 1987.

    Args:
        residual: Differences.
        tolerance: Difference that costs half.

    Returns:
        Costs in [0, 1), of the same shape.

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
    """Costs of the views warped by each disparity map, summed in each sector.

    A view read outside its image is not counted.

    Args:
        features: ``[v, u, h, w, c]`` views or features of them. Two of half precision (float16) are
            read in one, which takes half of the time on a CPU but has no derivative in them.
        disparities: ``[d, h, w]`` of the centre view, pixels per view step.
        penalties: What a view costs, in one measure or several, given the differences of its
            features from those of the centre view: a map ``[h, w]`` for each.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        Sums ``[m, 8, d, h, w]`` of the m measures, weights ``[8, d, h, w]``.

    Raises:
        InputError: If there is no view beside the centre view, or for integer features.

    Example:
        >>> features, maps = jnp.zeros((3, 3, 8, 8, 1)), jnp.zeros((5, 8, 8))
        >>> costs = refined_sector_costs(
        ...     features, maps, penalties=lambda differences: [jnp.abs(differences[0])]
        ... )
        >>> costs.sums.shape, float(costs.weights[:, 0, 4, 4].sum())
        ((1, 8, 5, 8, 8), 8.0)
    """
    features = as_images(features, "v u h w c", "features")
    (disparities,) = as_coordinates(disparities)
    v, u, h, w, c = features.shape
    around = views_around((v, u), offsets)
    listed = features.reshape(v * u, h, w, c)
    centre = jnp.moveaxis(listed[around.centre], -1, 0)
    if features.dtype == jnp.float16 and c == 2:
        images, centre = as_pairs(listed), centre.astype(jnp.float32)
        warped = warp_pair
    else:
        images = jnp.moveaxis(listed, -1, 1)

        def warped(image, disparity, offset):
            return [warp_plane(channel, disparity, offset) for channel in image]

    def add_view(totals, view):
        index, sector, offset, present = view
        image = images[index]

        def one(disparity):
            seen = (present & inside_view(disparity, offset)).astype(centre.dtype)
            views = warped(image, disparity, offset)
            differences = [view - here for view, here in zip(views, centre, strict=True)]
            return *(seen * cost for cost in penalties(differences)), seen

        terms = jax.vmap(one)(disparities)
        return [total.at[sector].add(term) for total, term in zip(totals, terms, strict=True)], None

    measures = len(jax.eval_shape(penalties, list(centre)))
    # One array for each measure: in one of all, XLA would compute the warps again for each.
    nothing = jnp.zeros((SECTORS, *disparities.shape), centre.dtype)
    *sums, weights = jax.lax.scan(add_view, [nothing] * (measures + 1), around[1:])[0]
    return SectorCosts(jnp.stack(sums), weights)


def sector_channels(costs: SectorCosts) -> Float[Array, "10 d h w"]:
    """Mean cost in each sector, in the whole aperture, and in the half of it that agrees best.

    Args:
        costs: Sums of one measure of :func:`refined_sector_costs`, or of
            :func:`occjax.ops.sector_sums`.

    Returns:
        ``[8 + 2, d, h, w]``. A sector that sees nothing has the mean of the whole aperture. The
        best half is chosen by means over 3x3 pixels: noise would choose from single ones.

    Example:
        >>> costs = SectorCosts(jnp.ones((8, 5, 6, 7)), jnp.full((8, 1, 1, 1), 2.0))
        >>> sector_channels(costs).shape
        (10, 5, 6, 7)
    """
    # Unrolled over the sectors, so that XLA computes every channel in one pass over the sums.
    sums, weights = list(costs.sums), list(costs.weights)
    little = 1e-3  # of a view, whose cost is the mean over all
    mean = sum(sums) / jnp.maximum(sum(weights), little)
    sectors = [
        (one_sum + little * mean) / (one_weight + little)
        for one_sum, one_weight in zip(sums, weights, strict=True)
    ]

    def half(first):
        part = [(first + step) % SECTORS for step in range(HALF_APERTURE)]
        weight = sum(weights[sector] for sector in part) + little
        return box_filter((sum(sums[sector] for sector in part) + little * mean) / weight, 1)

    best = half(0)
    for first in range(1, SECTORS):
        best = jnp.minimum(best, half(first))
    return jnp.stack([*sectors, mean, best])
