"""Matching costs: how well the views agree with the centre view at each disparity candidate.

An occluder hides a point from the views on one side. Therefore the views are divided into eight
sectors by their direction, and each pixel uses the part of the aperture that agrees best: the
whole, or one of eight quarters (three neighbouring sectors, the outer two counted half).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.kernels.bilinear import displaced_plane
from occjax.kernels.padding import pad_borders
from occjax.lightfield import centre_index
from occjax.models.proposal.aperture import SECTORS, other_views, sum_over_views
from occjax.models.proposal.config import CostConfig, NoiseConfig
from occjax.models.proposal.filters import (
    BINOMIAL_CORRELATION,
    BINOMIAL_GAIN,
    binomial_filter,
    box_filter,
    central_differences,
)
from occjax.models.proposal.noise import (
    expected_truncated_error,
    interpolation_gain,
    texture_weight,
)
from occjax.ops.sampling import as_coordinates, as_images

T = TypeVar("T")


def photometric_costs(
    views: Float[Array, "v u h w"],
    candidates: Float[Array, " d"],
    level: Float[Array, ""],
    config: CostConfig,
    noise: NoiseConfig,
    *,
    offsets: Float[Array, "v u 2"] | None = None,
) -> Float[Array, "d h w"]:
    """Compute costs of grey and its derivatives, and of blurred grey where noise hides texture.

    Derivatives are not affected by vignetting and by the broad part of highlights, and they tell
    weakly textured surfaces apart: :func:`aperture_costs` of grey and both derivatives. Each
    truncation is widened by the noise, since noise beyond a truncation makes all candidates alike.

    Where the derivatives are noise (:func:`occjax.models.proposal.noise.texture_weight`), the costs
    are those of grey after :func:`occjax.models.proposal.filters.binomial_filter`, over the whole
    aperture.

    Args:
        views: ``[v, u, h, w]`` grey views.
        candidates: ``[d]`` disparities, pixels per view step.
        level: Standard deviation of the noise (:func:`occjax.models.proposal.noise.noise_level`).
        config: Truncations and window.
        noise: Transition from texture to noise.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        ``[d, h, w]`` costs in [0, 1].

    Raises:
        InputError: If there is only one view, or for integer views.

    Example:
        >>> ramp = jnp.tile(jnp.arange(8.0)[None, :, None], (8, 1, 1))
        >>> views = jnp.stack([ramp - 1.0, ramp, ramp + 1.0])[None, ..., 0]  # disparity 1
        >>> config = CostConfig(grey_truncation=4.0, derivative_truncation=1.0)
        >>> candidates = jnp.array([-1.0, 0.0, 1.0])
        >>> costs = photometric_costs(views, candidates, jnp.zeros(()), config, NoiseConfig())
        >>> costs[:, 4, 4].argmin().tolist()
        2
    """
    views = as_images(views, "v u h w")
    v, u = views.shape[:2]
    # A central difference, half of that of two pixels, has half the variance.
    deviation = level * jnp.sqrt(jnp.array([1.0, 0.5, 0.5], views.dtype))
    truncation = jnp.array(
        [config.grey_truncation, config.derivative_truncation, config.derivative_truncation],
        views.dtype,
    )
    sharp = aperture_costs(
        jnp.stack([views, *central_differences(views)], axis=-1),
        candidates,
        truncation=jnp.hypot(truncation, deviation),
        noise=deviation,
        radius=config.window_radius_px,
        offsets=offsets,
    )
    blurred_deviation = BINOMIAL_GAIN * level[None]
    blurred_truncation = jnp.array([config.blurred_truncation], views.dtype)
    blurred = sector_sums(
        binomial_filter(views)[..., None],
        candidates,
        truncation=jnp.hypot(blurred_truncation, blurred_deviation),
        noise=blurred_deviation,
        correlation=jnp.full((1, 2), BINOMIAL_CORRELATION, views.dtype),
        offsets=offsets,
        combine=lambda sums, counts: box_filter(sums[0] / counts[0], config.window_radius_px),
        by_sector=False,
    )
    weight = texture_weight(views[centre_index((v, u))], level, noise)[None]
    return weight * sharp + (1 - weight) * blurred


def aperture_costs(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    *,
    truncation: Float[Array, " c"],
    noise: Float[Array, " c"] | None = None,
    radius: int = 1,
    offsets: Float[Array, "v u 2"] | None = None,
) -> Float[Array, "d h w"]:
    """Compute truncated absolute differences to the centre view over the best part of the aperture.

    The cost of a candidate is the smallest of the means of the ``e_k`` of :func:`sector_sums` over
    all views and over the eight quarters of the aperture.

    Args:
        features: ``[v, u, h, w, c]`` views or features of them.
        candidates: ``[d]`` disparities, pixels per view step.
        truncation: ``[c]`` difference of each feature above which the cost is constant.
        noise: ``[c]`` standard deviation of the noise of each feature (:func:`sector_sums`).
        radius: Radius of the window over which ``e_k`` is averaged before the best part is chosen,
            in pixels. Without a window, noise decides the choice.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        ``[d, h, w]`` costs in [0, 1].

    Raises:
        InputError: If there is only one view, or for integer features.

    Example:
        >>> ramp = jnp.tile(jnp.arange(8.0)[None, :, None], (8, 1, 1))
        >>> views = jnp.stack([ramp - 1.0, ramp, ramp + 1.0])[None]  # disparity 1
        >>> candidates = jnp.array([-1.0, 0.0, 1.0])
        >>> aperture_costs(views, candidates, truncation=jnp.array([4.0]))[:, 4, 4].tolist()
        [0.5, 0.25, 0.0]
    """
    return sector_sums(
        features,
        candidates,
        truncation=truncation,
        noise=noise,
        offsets=offsets,
        combine=lambda sums, counts: best_part(box_filter(sums, radius), counts),
    )


def sector_sums(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    *,
    truncation: Float[Array, " c"],
    combine: Callable[[Float[Array, "s h w"], Float[Array, " s"]], T],
    noise: Float[Array, " c"] | None = None,
    correlation: Float[Array, "c 2"] | None = None,
    offsets: Float[Array, "v u 2"] | None = None,
    by_sector: bool = True,
) -> T:
    """Sum truncated absolute differences to the centre view in each sector of the aperture.

    For view k shifted by a candidate,
    ``e_k = mean_c min(|feature_k - feature_centre| / truncation_c, 1)``. Borders are replicated.
    Time is O(v u d h w c); memory is that of the padded features and of the result.

    Args:
        features: ``[v, u, h, w, c]`` views or features of them, for example grey and its gradients.
        candidates: ``[d]`` disparities, pixels per view step.
        truncation: ``[c]`` difference of each feature above which the cost is constant, so that
            highlights and occluders have a bounded effect.
        combine: Function that reduces each candidate: from the sums ``[s, h, w]`` of ``e_k`` and
            the number ``[s]`` of views in each of the s sectors it computes the result.
        noise: ``[c]`` standard deviation of the noise of each feature. The mean difference is
            corrected for the bias that interpolation of noise gives to sub-pixel candidates.
        correlation: ``[c, 2]`` correlation of each feature's noise between neighbouring pixels
            ``(along a column, along a row)``; zero by default. Interpolation reduces correlated
            noise less.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.
        by_sector: Sum the views of each sector; False sums all views, as if they were one sector.

    Returns:
        The result of ``combine``, with a leading axis of candidates.

    Raises:
        InputError: If there is only one view, or for integer features.

    Example:
        >>> views = jnp.zeros((3, 3, 8, 8, 1)).at[0].set(1.0)  # the upper row differs
        >>> kept = sector_sums(
        ...     views, jnp.zeros(2), truncation=jnp.ones(1), combine=lambda sums, counts: sums
        ... )
        >>> kept[1, :, 4, 4].tolist()
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
    """
    features = as_images(features, "v u h w c", "features")
    v, u, h, w, c = features.shape
    others = other_views((v, u), offsets).by_sector()
    counts = others.sector_counts.astype(features.dtype)
    if not by_sector:
        counts = counts.sum(keepdims=True)
    planes = jnp.moveaxis(features.reshape(v * u, h, w, c), -1, 1)
    centre = planes[others.centre]
    # Padded once for all shifts. A view that is shifted by more than the margin is compared at the
    # margin; it shows little of the image anyway.
    margin = max(h, w) // 4 + 1
    padded = pad_borders(planes, (margin, margin + 1), (margin, margin + 1))
    candidates, displacements = as_coordinates(candidates, -others.offset)
    scale = jnp.where(others.present[:, None], 1 / (c * truncation[None]), 0.0).astype(
        features.dtype
    )
    zero = jnp.zeros((h, w), features.dtype)
    if noise is None:
        noise = jnp.zeros_like(truncation)
    if correlation is None:
        correlation = jnp.zeros((c, 2), truncation.dtype)

    @jax.checkpoint
    def plane(candidate):
        bias = _interpolation_bias(noise, truncation, candidate * displacements, correlation)

        def view_error(step):
            view, displacement, scale, bias = step
            error = zero
            for channel in range(c):
                index = view, np.int32(channel)
                shifted = displaced_plane(padded, index, candidate * displacement, margin)
                difference = jnp.abs(shifted - centre[channel]) + bias[channel]
                error = error + jnp.minimum(difference * scale[channel], 1 / c)
            return error

        steps = others.indices, displacements, scale, bias
        sums = sum_over_views(view_error, steps, zero, others.sector if by_sector else None)
        return combine(sums, counts)

    return jax.lax.map(plane, candidates)


def best_part(sums: Float[Array, "8 h w"], counts: Float[Array, " 8"]) -> Float[Array, "h w"]:
    """Compute the smallest of the means over all views and over the quarters of the aperture.

    Args:
        sums: ``[8, h, w]`` sums over the views of each sector.
        counts: ``[8]`` number of views in each sector.

    Returns:
        ``[h, w]`` smallest mean; quarters without views are ignored.

    Example:
        >>> sums = jnp.ones((8, 1, 1)).at[1:4].set(0.0)
        >>> float(best_part(sums, jnp.ones(8))[0, 0])
        0.0
    """
    part_counts = jnp.tensordot(jnp.asarray(_PARTS, sums.dtype), counts, 1, precision="highest")
    # A quarter of a grid of one row may be empty.
    penalty = jnp.where(part_counts > 0, 0.0, jnp.inf).astype(sums.dtype)
    factors = 1 / jnp.maximum(part_counts, 1e-9)

    def mean(part: int) -> Float[Array, "h w"]:
        # Unrolled, all parts are computed in one pass over memory.
        terms = (float(share) * sums[sector] for sector, share in enumerate(_PARTS[part]) if share)
        return sum(terms, jnp.zeros_like(sums[0])) * factors[part] + penalty[part]

    return functools.reduce(jnp.minimum, map(mean, range(len(_PARTS))))


def _aperture_parts() -> np.ndarray:
    """Return ``[1 + 8, 8]`` the share of each sector in the aperture and in each quarter of it."""
    turn = (np.arange(SECTORS)[:, None] - np.arange(SECTORS)[None, :]) % SECTORS
    distance = np.minimum(turn, SECTORS - turn)
    quarters = np.select([distance < 1, distance == 1], [1.0, 0.5], 0.0)
    return np.concatenate([np.ones((1, SECTORS)), quarters])


_PARTS = _aperture_parts()


def _interpolation_bias(
    noise: Array, truncation: Array, displacements: Array, correlation: Array
) -> Array:
    """Compute by how much interpolation of noise lowers the mean truncated error, ``[n, c]``."""

    def mean_error(displacement: Array) -> Array:
        gain = interpolation_gain(jnp.broadcast_to(displacement, correlation.shape), correlation)
        return expected_truncated_error(noise * jnp.sqrt(1 + gain).astype(noise.dtype), truncation)

    at_whole_pixels = expected_truncated_error(noise * np.sqrt(2).item(), truncation)
    return at_whole_pixels[None] - jax.vmap(mean_error)(displacements)
