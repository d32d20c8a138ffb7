"""What the light network chooses from: disparities proposed for each pixel, and their costs.

All of it is computed without weights, by the steps of the photometric estimator and one more:
truncated costs over the best part of the aperture, their means over large surroundings, semi-global
aggregation, planes through Lucas-Kanade steps. The whole range is searched at half resolution,
which takes a quarter of the time and finds as much: noise is weaker there, and where edges lie is
for the choice to say. Away from depth edges the result is right, or nothing in the light field
shows what is. Along an edge the costs of a pixel are mixed with those of the other surface, and the
right disparity is that of a pixel a few places away. So each pixel is proposed the disparities of
some neighbours, and that of the second best surface the aggregation knows.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Float16

from occjax.models.config import DerivativeFeatures, NetworkConfig, SemiGlobalConfig, of_kind
from occjax.ops.brightness import vignetted
from occjax.ops.filtering import box_filter, edge_aware_mean, neighbours
from occjax.ops.matching import grey_costs, semi_global
from occjax.ops.noise import noise_level, noisiness
from occjax.ops.planes import greatest_plane, least_plane, softmax_planes
from occjax.ops.refinement import median_filter, refine_disparity, refinement_features
from occjax.ops.regression import cheapest, confidence
from occjax.ops.resolution import blocks, double, halve, unblocked
from occjax.ops.sectors import (
    SectorCosts,
    geman_mcclure,
    refined_sector_costs,
    sector_channels,
)

GREY_TOLERANCE = 0.03
"""Grey difference between views that costs half."""

DETAIL_TOLERANCE = 0.01
"""The same of what is left of grey without the mean of its surroundings."""

REACH = 30.0
"""Reach of the means of costs in the absence of edges, pixels of half resolution."""

EDGE = 0.03
"""Difference of grey that bounds them."""

PLANE_RADIUS = 12.0
"""Reach of the fitted planes in the absence of edges, pixels."""

DARKNESS = 0.01
"""Grey up to which the sides of the centre view count as vignetted."""

SLOPE_STEP = 8
"""Pixels over which the slope of a surface is taken, about as far as it is continued."""

LARGEST_AGGREGATED = 2.0
"""Aggregated cost above that of the best candidate from which on more makes no difference."""

BEST_HALF = 9
"""Which of the costs of proposals is that of the aperture's best half."""


class GreyViews(NamedTuple):
    """What is compared.

    Attributes:
        views: ``[v, u, h, w]`` grey, the white of the centre view at 0.8.
        offsets: ``[v, u, 2]`` of the views, scaled to the network's reach.
    """

    views: Float[Array, "v u h w"]
    offsets: Float[Array, "v u 2"]

    @property
    def centre(self) -> Float[Array, "h w"]:
        """The centre view."""
        v, u = self.views.shape[:2]
        return self.views[v // 2, u // 2]

    @property
    def detail(self) -> Float[Array, "v u h w"]:
        """Grey without the mean of its surroundings; resists highlights, but not noise."""
        return self.views - box_filter(self.views, 1)


class Proposals(NamedTuple):
    """Disparities to choose from, and what speaks for each.

    Attributes:
        centre: ``[h, w]`` centre view, grey.
        disparity: ``[h, w]`` of the photometric steps.
        proposed: ``[k, h, w]`` disparities: that one first.
        costs: ``[k, 13, h, w]`` in [0, 1]: of each sector of the aperture, of all of it and of its
            best half (grey, :func:`occjax.ops.geman_mcclure`); of the best half the mean absolute
            difference of grey, and the robust cost of its detail; the aggregated cost at that
            disparity.
        spread: ``[2, h, w]`` scaled logarithm of the variance of the first stage's candidates,
            and the probability of the likeliest.
    """

    centre: Float[Array, "h w"]
    disparity: Float[Array, "h w"]
    proposed: Float[Array, "k h w"]
    costs: Float16[Array, "k 13 h w"]
    spread: Float[Array, "2 h w"]


class Search(NamedTuple):
    """The first stage, at half resolution; disparities and candidates are those of full resolution.

    Attributes:
        disparity: ``[i, j]`` of least cost.
        aggregated: ``[d, i, j]`` aggregated costs, 0 for the cheapest candidate.
        probabilities: ``[d, i, j]`` of the candidates.
    """

    disparity: Float[Array, "i j"]
    aggregated: Float[Array, "d i j"]
    probabilities: Float[Array, "d i j"]


def search(grey: GreyViews, candidates: Float[Array, " d"], config: NetworkConfig) -> Search:
    """Search the whole range: costs of all candidates, aggregated semi-globally.

    Noisy walls tell their disparity by all of their pixels together. So the costs that are
    aggregated have the means over large surroundings added to them, as far as there is noise; and
    since surfaces are slanted, these means are taken once more, along the surfaces found.

    Args:
        grey: The views, of even height and width.
        candidates: ``[d]`` evenly spaced disparities.
        config: The network.

    Returns:
        Disparity, costs and probabilities.
    """
    compared = of_kind(config.features, DerivativeFeatures)
    prior = of_kind(config.stages[0].semi_global, SemiGlobalConfig)
    grey = GreyViews(halve(grey.views), grey.offsets)
    edges = box_filter(grey.centre, 1)[None] / EDGE
    halved = candidates / 2  # in pixels of half resolution
    noise = noise_level(grey.views, halved, offsets=grey.offsets)
    costs = grey_costs(
        grey.views,
        halved,
        grey_truncation=compared.grey_truncation,
        derivative_truncation=compared.derivative_truncation,
        noise=noise,
        offsets=grey.offsets,
    )
    dark = vignetted(grey.centre, DARKNESS)
    costs = jnp.where(dark[None], 0.0, costs)
    aggregated = semi_global(
        costs + noisiness(noise) * edge_aware_mean(costs, edges, radius=REACH),
        grey.centre,
        small_penalty=prior.smoothness * _spacing(candidates),
        large_penalty=prior.jump,
        guide_scale=prior.edge,
    )
    aggregated = aggregated - least_plane(aggregated)[None]
    disparity = cheapest(aggregated, candidates)
    along = _along_surfaces(costs, candidates, disparity, edges)
    # Where all is dark, only what was carried there along the paths is left.
    disparity = jnp.where(dark, disparity, along)
    return Search(disparity, aggregated, softmax_planes(-aggregated / prior.temperature))


def _along_surfaces(
    costs: Float[Array, "d i j"],
    candidates: Float[Array, " d"],
    disparity: Float[Array, "i j"],
    edges: Float[Array, "1 i j"],
) -> Float[Array, "i j"]:
    """The disparity of least mean cost, the surroundings being displaced like the pixel itself."""
    changes = _spacing(candidates) * jnp.linspace(-2.0, 2.0, 5, dtype=candidates.dtype)
    around = disparity[None] + changes[:, None, None]
    within = (around >= candidates[0]) & (around <= candidates[-1])
    displaced = jnp.where(within, _interpolated(costs, candidates, around), 1.0)
    means = edge_aware_mean(displaced, edges, radius=REACH)
    return disparity + cheapest(means, changes)


def refine(
    grey: GreyViews, found: Search, candidates: Float[Array, " d"], config: NetworkConfig
) -> Float[Array, "h w"]:
    """What the search found, refined by planes.

    Args:
        grey: The views.
        found: By the first stage.
        candidates: ``[d]`` its candidates.
        config: The network; its second stage says by how many steps.

    Returns:
        ``[h, w]`` disparity.
    """
    disparity = double(median_filter(found.disparity))
    return refine_disparity(
        refinement_features(grey.views, disparity, offsets=grey.offsets),
        disparity,
        grey.centre,
        offsets=grey.offsets,
        steps=config.stages[1].plane_steps,
        largest_step=_spacing(candidates),
        radius=PLANE_RADIUS,
    )


def propose(
    grey: GreyViews,
    found: Search,
    disparity: Float[Array, "h w"],
    candidates: Float[Array, " d"],
    config: NetworkConfig,
) -> Proposals:
    """Disparities to choose from.

    Args:
        grey: The views.
        found: By the first stage.
        disparity: ``[h, w]`` as it is.
        candidates: ``[d]`` of the first stage.
        config: The network; its second stage says what is proposed.

    Returns:
        The proposals.
    """
    stage = config.stages[1]
    proposed = jnp.concatenate(
        [
            disparity[None],
            _continued(disparity, stage.neighbours),
            double(_second(found, candidates, stage.second))[None],
        ]
    )

    def penalties(differences):
        of_grey, of_detail = differences
        return (
            geman_mcclure(of_grey, GREY_TOLERANCE),
            jnp.abs(of_grey),
            geman_mcclure(of_detail, DETAIL_TOLERANCE),
        )

    # Two of half precision are read in one; their steps are an eighth of those of 8-bit images.
    features = jnp.stack([grey.views, grey.detail], axis=-1).astype(jnp.float16)

    def costs_of(one: Float[Array, "h w"]) -> Float[Array, "13 h w"]:
        costs = refined_sector_costs(features, one[None], penalties=penalties, offsets=grey.offsets)
        robust, absolute, of_detail = (
            sector_channels(SectorCosts(sums, costs.weights)) for sums in costs.sums
        )
        prior = _of_blocks(found.aggregated, candidates, one)[None] / LARGEST_AGGREGATED
        all_costs = jnp.concatenate([robust[:, 0], absolute[-1], of_detail[-1], prior])
        return jnp.clip(all_costs, 0.0, 1.0).astype(jnp.float16)

    # One proposal at a time: a quarter of the memory, in no more time.
    costs = jax.lax.map(costs_of, proposed)
    reading = confidence(found.probabilities, candidates)
    spread = jnp.stack(
        [
            0.3 * jnp.log(jnp.square(reading.standard_deviation) + 1e-3),
            greatest_plane(found.probabilities),
        ]
    )
    return Proposals(grey.centre, disparity, proposed, costs, double(spread))


def _spacing(candidates: Float[Array, " d"]) -> Float[Array, ""]:
    return (candidates[-1] - candidates[0]) / (len(candidates) - 1)


def _continued(
    disparity: Float[Array, "h w"], places: tuple[tuple[int, int], ...]
) -> Float[Array, "n h w"]:
    """The disparity that the surfaces of some neighbours would have here.

    Each surface is continued by its slope, so that on one surface, however slanted, all neighbours
    propose the same. The slope is the smaller of those on either side, which at an edge is the
    surface's own, and none where they disagree about its sign.
    """
    continued = neighbours(disparity, places)
    for axis, step in enumerate(((SLOPE_STEP, 0), (0, SLOPE_STEP))):
        before, after = neighbours(disparity, [(-step[0], -step[1]), step])
        rise, further = (disparity - before) / SLOPE_STEP, (after - disparity) / SLOPE_STEP
        smaller = jnp.sign(rise) * jnp.minimum(jnp.abs(rise), jnp.abs(further))
        slope = jnp.where(rise * further > 0.0, smaller, 0.0)
        # Beside the image's border there is but one side.
        size = disparity.shape[axis]
        at = jnp.expand_dims(jnp.arange(size), 1 - axis)
        slope = jnp.where(at >= size - SLOPE_STEP, rise, slope)
        slope = jnp.where(at < SLOPE_STEP, further, slope)
        way = jnp.array([place[axis] for place in places], disparity.dtype)
        continued = continued - way[:, None, None] * neighbours(slope, places)
    return continued


def _second(found: Search, candidates: Float[Array, " d"], distance: float) -> Float[Array, "i j"]:
    """The cheapest of the candidates at least this far from the best one."""
    far = jnp.abs(candidates[:, None, None] - found.disparity[None]) > distance
    # A large number, not infinity: the parabola through the neighbours shall stay finite.
    return cheapest(jnp.where(far, found.aggregated, 1e3), candidates)


def _of_blocks(
    volume: Float[Array, "d i j"], candidates: Float[Array, " d"], disparity: Float[Array, "h w"]
) -> Float[Array, "h w"]:
    """The values of a volume of half resolution at the disparity of each pixel."""
    apart = blocks(disparity)
    values = _interpolated(volume, candidates, apart.reshape(4, *volume.shape[1:]))
    return unblocked(values.reshape(apart.shape))


def _interpolated(
    volume: Float[Array, "d i j"],
    candidates: Float[Array, " d"],
    disparities: Float[Array, "k i j"],
) -> Float[Array, "k i j"]:
    """The values of a volume at disparities between its candidates."""
    place = (disparities - candidates[0]) / _spacing(candidates)
    place = jnp.clip(place, 0.0, volume.shape[0] - 1)
    below = jnp.minimum(jnp.floor(place).astype(jnp.int32), volume.shape[0] - 2)
    share = place - below.astype(place.dtype)
    left, right = (jnp.take_along_axis(volume, below + step, axis=0) for step in (0, 1))
    return left + share * (right - left)
