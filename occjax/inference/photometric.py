"""Disparity without learning: robust matching costs, aggregated along the edges of the image.

The steps, each a function of :mod:`occjax.ops`:

1. brightness by the centre view's own white, so that exposure and bit depth do not matter;
2. costs of all candidates from grey and its derivatives, best part of the aperture, without the
   favour that noise does to candidates between pixels; of blurred grey where noise hides texture;
3. semi-global aggregation guided by the centre view, which carries disparity across untextured
   regions and stops at edges;
4. the cheapest candidate, to a fraction of the spacing by a parabola through its neighbours;
5. refinement by planes through what all views, weighted by visibility and texture, say near it;
6. confidence from the spread of the aggregated costs, occlusion maps from the disparity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.errors import InputError
from occjax.lightfield import GREY_WEIGHTS
from occjax.ops import (
    cheapest,
    confidence,
    grey_costs,
    median_filter,
    occlusion_maps,
    refine_disparity,
    refinement_features,
    semi_global,
)
from occjax.ops.brightness import WHITE, vignetted, white_level
from occjax.ops.planes import softmax_planes
from occjax.ops.sampling import as_images


@dataclass(frozen=True)
class PhotometricConfig:
    """Settings of :func:`photometric`; the defaults suit images of any scene and exposure.

    Grey is measured so that the 99th percentile of the centre view is 0.8, as in a picture that is
    well exposed between 0 and 1.

    Attributes:
        grey_truncation: Grey difference that counts as "something else".
        gradient_truncation: The same for a derivative of the grey image, per pixel.
        smoothness: Cost of a disparity that changes by one pixel per view step from pixel to pixel.
        jump: Greatest cost of a depth edge, where the image has none.
        darkness: Grey up to which a part of the centre view along its sides counts as vignetted, as
            the corners of plenoptic cameras: it says nothing, its surroundings decide.
        edge: Grey difference between neighbouring pixels over which a depth edge becomes cheaper by
            a factor e.
        temperature: Difference of aggregated cost over which a candidate becomes less probable by a
            factor e; sets confidence and standard deviation, not disparity.
        refinement_steps: Number of Lucas-Kanade steps after the search; 0 leaves them out.
        refinement_radius: Reach of the planes fitted in each, in pixels.
    """

    grey_truncation: float = 0.02
    gradient_truncation: float = 0.004
    smoothness: float = 0.6
    jump: float = 2.0
    darkness: float = 0.01
    edge: float = 0.03
    temperature: float = 0.1
    refinement_steps: int = 3
    refinement_radius: float = 12.0


class PhotometricResult(NamedTuple):
    """What :func:`photometric` returns.

    Attributes:
        disparity: ``[h, w]`` of the centre view, pixels per view step.
        confidence: ``[h, w]`` in [0, 1], one minus the entropy of the candidates over its maximum.
        standard_deviation: ``[h, w]`` of the candidates' probabilities, in the unit of disparity.
        occlusion: ``[v, u, h, w]`` occlusion map of each view (:func:`occjax.ops.occlusion_maps`).
        coarse: ``[h, w]`` disparity before refinement.
    """

    disparity: Float[Array, "h w"]
    confidence: Float[Array, "h w"]
    standard_deviation: Float[Array, "h w"]
    occlusion: Float[Array, "v u h w"]
    coarse: Float[Array, "h w"]


def photometric(
    views: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    *,
    offsets: Float[Array, "v u 2"] | None = None,
    config: PhotometricConfig = PhotometricConfig(),
) -> PhotometricResult:
    """Estimate the disparity of the centre view from photo-consistency alone.

    Pure: works under jit, vmap and grad (``config`` is static). Needs no weights and takes any grid
    of at least two views; more views and more texture make it more accurate.

    Args:
        views: ``[v, u, h, w, c]`` views in [0, 1], grey or RGB, at least 3x3 pixels. Disparity and
            confidence do not depend on the unit of brightness; the occlusion maps are in it.
        candidates: ``[d]`` evenly spaced disparities to search, pixels per view step; a
            spacing of an eighth of a pixel is enough.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.
        config: Settings.

    Returns:
        Disparity, its confidence and standard deviation, and the occlusion maps.

    Raises:
        InputError: For a single view, fewer than three candidates, images of less than 3x3 pixels,
            or views that are not grey or RGB in floating point.

    Example:
        >>> import jax
        >>> texture = jax.random.uniform(jax.random.key(0), (1, 3, 16, 24, 1))
        >>> views = jnp.stack([jnp.roll(texture[0, 0], -k, axis=1) for k in (-1, 0, 1)])[None]
        >>> result = photometric(views, jnp.linspace(-2.0, 2.0, 9))
        >>> round(float(result.disparity[8, 12]), 1)
        1.0
    """
    views, candidates = as_images(views, "v u h w c"), jnp.asarray(candidates)
    if len(candidates) < 3:
        raise InputError(f"photometric searches at least 3 candidates, not {len(candidates)}")
    v, u, h, w, c = views.shape
    if c not in (1, 3):
        raise InputError(f"photometric needs grey or RGB views, not {c} channels")
    if min(h, w) < 3:
        raise InputError(f"photometric needs images of at least 3x3 pixels (h x w), not {h}x{w}")
    dtype = jnp.float64 if views.dtype == jnp.float64 else jnp.float32
    views, candidates = views.astype(dtype), jnp.sort(candidates.astype(dtype))
    original = _grey(views)
    grey = original * (WHITE / white_level(original[v // 2, u // 2]))
    centre = grey[v // 2, u // 2]
    costs = grey_costs(
        grey,
        candidates,
        grey_truncation=config.grey_truncation,
        derivative_truncation=config.gradient_truncation,
        offsets=offsets,
    )
    costs = jnp.where(vignetted(centre, config.darkness), 0.0, costs)
    spacing = (candidates[-1] - candidates[0]) / (len(candidates) - 1)
    costs = semi_global(
        costs,
        centre,
        small_penalty=config.smoothness * spacing,
        large_penalty=config.jump,
        guide_scale=config.edge,
    )
    coarse = median_filter(cheapest(costs, candidates))
    disparity = refine_disparity(
        refinement_features(grey, coarse, offsets=offsets),
        coarse,
        centre,
        offsets=offsets,
        steps=config.refinement_steps,
        largest_step=spacing,
        radius=config.refinement_radius,
    )
    disparity = jnp.clip(disparity, candidates[0], candidates[-1])
    probabilities = softmax_planes(-costs / config.temperature)
    spread = confidence(probabilities, candidates)
    occlusion = occlusion_maps(original[..., None], disparity, offsets=offsets)
    certainty = spread.certainty(len(candidates))
    return PhotometricResult(disparity, certainty, spread.standard_deviation, occlusion, coarse)


def _grey(views: Array) -> Array:
    if views.shape[-1] == 1:
        return views[..., 0]
    return jnp.tensordot(views, jnp.array(GREY_WEIGHTS, views.dtype), 1, precision="highest")
