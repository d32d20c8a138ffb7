"""Sub-pixel refinement of a disparity map by Lucas-Kanade steps on all views and fitted planes.

A step linearises every view around the current disparity d (Lucas and Kanade, IJCAI 1981). With the
residual ``r_k = feature_k(warped by d) - feature_centre`` and its derivative
``g_k = -offset_k . gradient(feature_centre)``, the views agree best at ``d + b / a`` where::

    a = sum_k w_k g_k^2        b = -sum_k w_k g_k r_k

``a`` is also the information of the pixel: the inverse variance of its disparity up to the noise.
It is large on texture and zero on a blank wall. Planes that are fitted with these weights let
textured pixels determine their untextured neighbours, up to the edges of image and disparity.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.kernels.bilinear import warp_plane
from occjax.kernels.median import median_filter
from occjax.models.proposal.aperture import nearest_views, other_views
from occjax.models.proposal.config import ProposalNetConfig, RefinementConfig
from occjax.models.proposal.filters import box_filter, central_differences, fit_planes
from occjax.models.proposal.noise import noise_level, subsample
from occjax.models.proposal.resolution import upsample2x
from occjax.models.proposal.search import GreyViews, SearchResult, candidate_spacing
from occjax.ops.sampling import as_images


class Refined(NamedTuple):
    """Refined disparity map.

    Attributes:
        disparity: ``[h, w]`` disparity, pixels per view step.
        information: ``[h, w]`` inverse variance of the disparity of each pixel by itself, before
            planes are fitted; zero without a step.
    """

    disparity: Float[Array, "h w"]
    information: Float[Array, "h w"]


def refine(
    grey: GreyViews,
    searched: SearchResult,
    candidates: Float[Array, " d"],
    config: ProposalNetConfig,
) -> tuple[Float[Array, "h w"], Refined]:
    """Refine the result of the search at full resolution.

    Args:
        grey: Views.
        searched: Result of the search.
        candidates: ``[d]`` candidates of the search, pixels per view step.
        config: All settings.

    Returns:
        ``[h, w]`` disparity before the refinement (median-filtered), and the refined disparity.
    """
    coarse = median_filter(searched.disparity)
    if config.search.downsampling == 2:
        coarse = upsample2x(coarse)
    level = noise_level(grey.views, coarse[None], config.noise, offsets=grey.offsets)
    refined = refine_disparity(
        refinement_features(grey.views, level, config.refinement),
        coarse,
        grey.centre,
        config.refinement,
        max_step=candidate_spacing(candidates),
        offsets=grey.offsets,
    )
    return coarse, refined


def refine_disparity(
    features: Float[Array, "v u h w c"],
    disparity: Float[Array, "h w"],
    guide: Float[Array, "h w"],
    config: RefinementConfig,
    *,
    max_step: Float[Array, ""] | float,
    offsets: Float[Array, "v u 2"] | None = None,
) -> Refined:
    """Refine a disparity map by Lucas-Kanade steps, each followed by a fit of weighted planes.

    The weight of a view, ``w_k = exp(-r^2 / noise)`` with r^2 the mean of squared residuals in a
    3x3 window, suppresses views in which the point is occluded or glossy. The noise is the median
    of r^2 in the views next to the centre view.

    Args:
        features: ``[v, u, h, w, c]`` views or features of them, h and w at least 2.
        disparity: ``[h, w]`` disparity of the centre view, correct to a fraction of a pixel.
        guide: ``[h, w]`` grey centre view.
        config: Number of steps, planes and edges.
        max_step: Largest change in one step, pixels per view step.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        Refined disparity and its information.

    Raises:
        InputError: If there is only one view, or for integer features.

    Example:
        >>> ramp = jnp.tile(jnp.arange(8.0)[None, :, None], (8, 1, 1))
        >>> views = jnp.stack([ramp - 1.0, ramp, ramp + 1.0])[None]  # disparity 1
        >>> start, guide = jnp.full((8, 8), 0.95), jnp.zeros((8, 8))
        >>> refined = refine_disparity(views, start, guide, RefinementConfig(), max_step=0.1)
        >>> round(float(refined.disparity[4, 4]), 2)
        1.0
    """
    features = as_images(features, "v u h w c", "features")
    v, u, h, w, c = features.shape
    others = other_views((v, u), offsets)
    stack = jnp.moveaxis(features.reshape(v * u, h, w, c), -1, 1)
    other_stack, centre = stack[others.indices], stack[others.centre]
    gradients_y, gradients_x = central_differences(centre)
    smooth_guide = box_filter(guide, 1)  # noise of the guide is not an edge
    nearest, nearest_offsets = nearest_views(others)
    zero = jnp.zeros_like(centre[0])
    # The information that all views would give if the gradient were the minimal one.
    prior = config.min_gradient**2 * len(stack)

    def residual(feature, offset, disparity):
        warped = [warp_plane(plane, disparity, offset) for plane in feature]
        differences = [plane - here for plane, here in zip(warped, centre, strict=True)]
        return differences, box_filter(sum(map(jnp.square, differences), zero), 1)

    def step(refined, _):
        disparity = refined.disparity
        near = jax.lax.map(
            lambda view: residual(*view, disparity)[1], (stack[nearest], nearest_offsets)
        )
        noise = jnp.maximum(jax.lax.stop_gradient(jnp.median(subsample(near))), 1e-8)

        @jax.checkpoint
        def add_view(sums, view):
            feature, offset = view
            differences, squared = residual(feature, offset, disparity)
            weight = jnp.exp(-squared / noise)
            down, right = offset.astype(centre.dtype)
            information, numerator = sums
            for difference, along_y, along_x in zip(
                differences, gradients_y, gradients_x, strict=True
            ):
                derivative = -(down * along_y + right * along_x)
                information = information + weight * jnp.square(derivative)
                numerator = numerator - weight * derivative * difference
            return (information, numerator), None

        views = (other_stack, others.offset)
        (information, numerator), _ = jax.lax.scan(add_view, (zero, zero), views)
        update = jnp.clip(numerator / (information + prior), -max_step, max_step)
        edges = jnp.stack([smooth_guide / config.guide_edge, disparity / config.disparity_edge])
        weights = information + 0.01 * prior
        planes = fit_planes(disparity + update, weights, edges, radius=config.radius_px)
        return Refined(planes, (information + prior) / noise), None

    return jax.lax.scan(step, Refined(disparity, zero), None, length=config.steps)[0]


def refinement_features(
    views: Float[Array, "v u h w"], level: Float[Array, ""], config: RefinementConfig
) -> Float[Array, "v u h w 3"]:
    """Return the derivatives of grey, and grey itself as far as noise hides the derivatives.

    Without noise, derivatives are more reliable: they are not affected by vignetting and by the
    broad part of highlights. But noise affects derivatives more than grey, because it is fine, and
    the shading that remains on a blank wall is broad. Therefore grey is weighted by the ratio of
    two variances: that of the noise of a derivative, and that of noise and variation of grey.

    Args:
        views: ``[v, u, h, w]`` grey views.
        level: Standard deviation of the noise, in grey levels.
        config: Variation of grey between views.

    Returns:
        ``[v, u, h, w, 3]`` features for :func:`refine_disparity`.

    Raises:
        InputError: For integer views.

    Example:
        >>> views = jnp.zeros((3, 3, 4, 6))
        >>> refinement_features(views, jnp.zeros(()), RefinementConfig()).shape
        (3, 3, 4, 6, 3)
    """
    views = as_images(views, "v u h w")
    variance = jnp.square(level)
    # A central difference, half of that of two pixels, has half the variance.
    weight = variance / 2 / (variance + config.view_variation**2)
    return jnp.stack([*central_differences(views), jnp.sqrt(weight) * views], axis=-1)
