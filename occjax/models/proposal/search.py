"""Semi-global search: the disparity of least cost over the whole range.

Matching costs of all candidates are aggregated along straight paths. Where the images are noisy, an
edge-aware mean of the costs over a large neighbourhood is added first: a noisy surface without
texture shows its disparity only in many pixels together. Since surfaces are slanted, the mean is
computed a second time along the surfaces that were found.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from occjax.kernels.reductions import min_leading, softmax_leading
from occjax.lightfield import centre_index
from occjax.models.proposal.config import ProposalNetConfig, SearchConfig
from occjax.models.proposal.costs import photometric_costs
from occjax.models.proposal.exposure import vignette_mask
from occjax.models.proposal.filters import box_filter, edge_aware_mean
from occjax.models.proposal.noise import noise_level, noise_weight
from occjax.models.proposal.resolution import downsample2x
from occjax.models.proposal.semi_global import semi_global
from occjax.ops import winner_takes_all


class GreyViews(NamedTuple):
    """Grey views with normalised brightness and their offsets.

    Attributes:
        views: ``[v, u, h, w]`` grey levels relative to the exposure's white.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in view
            steps of the configured reach.
        colour: ``[c, h, w]`` channels of the centre view, at the same brightness; None if only its
            grey is known.
    """

    views: Float[Array, "v u h w"]
    offsets: Float[Array, "v u 2"]
    colour: Float[Array, "c h w"] | None = None

    @property
    def centre(self) -> Float[Array, "h w"]:
        """Centre view."""
        return self.views[centre_index(self.views.shape[:2])]

    @property
    def appearance(self) -> Float[Array, "c h w"]:
        """Channels of the centre view, or its grey."""
        return self.centre[None] if self.colour is None else self.colour


class SearchResult(NamedTuple):
    """Result of the search; disparities are those of full resolution.

    Attributes:
        disparity: ``[i, j]`` disparity of least cost.
        costs: ``[d, i, j]`` matching costs, before the aggregation.
        aggregated: ``[d, i, j]`` aggregated costs; that of the best candidate is 0.
        probabilities: ``[d, i, j]`` probability of each candidate.
    """

    disparity: Float[Array, "i j"]
    costs: Float[Array, "d i j"]
    aggregated: Float[Array, "d i j"]
    probabilities: Float[Array, "d i j"]


def search(
    grey: GreyViews, candidates: Float[Array, " d"], config: ProposalNetConfig
) -> SearchResult:
    """Search the whole disparity range.

    Args:
        grey: Views; height and width must be multiples of the factor of downsampling.
        candidates: ``[d]`` evenly spaced disparities, at least 3, pixels per view step.
        config: All settings.

    Returns:
        Disparity, costs and probabilities, downsampled as configured.
    """
    settings = config.search
    shifts = candidates  # in pixels of the search
    if settings.downsampling == 2:
        grey, shifts = grey._replace(views=downsample2x(grey.views)), candidates / 2
    level = noise_level(grey.views, shifts, config.noise, offsets=grey.offsets)
    costs = photometric_costs(
        grey.views, shifts, level, config.costs, config.noise, offsets=grey.offsets
    )
    vignetted = vignette_mask(grey.centre, config.exposure.vignette)
    costs = jnp.where(vignetted[None], 0.0, costs)
    with_context = costs
    if settings.context_radius_px:
        edges = box_filter(grey.centre, 1)[None] / settings.context_edge
        context = edge_aware_mean(costs, edges, radius=settings.context_radius_px)
        with_context = costs + noise_weight(level, config.noise) * context
    aggregated = semi_global(
        with_context,
        grey.centre,
        small_penalty=settings.smoothness * candidate_spacing(candidates),
        large_penalty=settings.max_edge_penalty,
        guide_scale=settings.edge_contrast,
    )
    aggregated = aggregated - min_leading(aggregated)[None]
    disparity = winner_takes_all(aggregated, candidates)
    if settings.context_radius_px:
        disparity = refine_along_surfaces(costs, candidates, disparity, edges, vignetted, settings)
    probabilities = softmax_leading(-aggregated / settings.temperature)
    return SearchResult(disparity, costs, aggregated, probabilities)


def candidate_spacing(candidates: Float[Array, " d"]) -> Float[Array, ""]:
    """Return the spacing of evenly spaced candidates."""
    return (candidates[-1] - candidates[0]) / (len(candidates) - 1)


def interpolate_volume(
    volume: Float[Array, "d i j"],
    candidates: Float[Array, " d"],
    disparities: Float[Array, "k i j"],
) -> Float[Array, "k i j"]:
    """Interpolate a volume linearly at disparities between its candidates.

    Args:
        volume: ``[d, i, j]`` values at the candidates.
        candidates: ``[d]`` evenly spaced disparities.
        disparities: ``[k, i, j]`` disparities; those outside the range are clipped to it.

    Returns:
        ``[k, i, j]`` interpolated values.

    Example:
        >>> volume = jnp.array([0.0, 1.0, 4.0])[:, None, None]
        >>> at = jnp.array([0.5, 1.5, 9.0])[:, None, None]
        >>> interpolate_volume(volume, jnp.arange(3.0), at)[:, 0, 0].tolist()
        [0.5, 2.5, 4.0]
    """
    position = (disparities - candidates[0]) / candidate_spacing(candidates)
    position = jnp.clip(position, 0.0, volume.shape[0] - 1)
    below = jnp.minimum(jnp.floor(position).astype(jnp.int32), volume.shape[0] - 2)
    fraction = position - below.astype(position.dtype)
    left, right = (jnp.take_along_axis(volume, below + step, axis=0) for step in (0, 1))
    return left + fraction * (right - left)


def refine_along_surfaces(
    costs: Float[Array, "d i j"],
    candidates: Float[Array, " d"],
    disparity: Float[Array, "i j"],
    edges: Float[Array, "1 i j"],
    vignetted: Bool[Array, "i j"],
    settings: SearchConfig,
) -> Float[Array, "i j"]:
    """Refine the disparity by the context mean of the costs along the surface that was found.

    Five small changes are compared; in each, all pixels of a neighbourhood change together.
    Vignetted pixels keep the disparity that the paths carried there.
    """
    changes = candidate_spacing(candidates) * jnp.linspace(-2.0, 2.0, 5, dtype=candidates.dtype)
    displaced = disparity[None] + changes[:, None, None]
    within = (displaced >= candidates[0]) & (displaced <= candidates[-1])
    costs = jnp.where(within, interpolate_volume(costs, candidates, displaced), 1.0)
    means = edge_aware_mean(costs, edges, radius=settings.context_radius_px)
    return jnp.where(vignetted, disparity, disparity + winner_takes_all(means, changes))
