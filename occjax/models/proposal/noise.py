"""Image noise: its level, the effect of interpolation on it, and how far it hides texture.

A view that is read between pixels is an average of up to four of them and therefore less noisy: of
independent noise of variance s^2 the fraction ``interpolation_gain`` s^2 remains, 1 at whole pixels
and 1/4 in the middle of four. Uncorrected, noise makes sub-pixel candidates look like better
matches. If the noise of neighbouring pixels is correlated, more of it remains.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.kernels.bilinear import warp_plane
from occjax.lightfield import centre_index
from occjax.models.proposal.aperture import nearest_views, other_views
from occjax.models.proposal.config import NoiseConfig
from occjax.models.proposal.filters import box_filter, central_differences
from occjax.ops.sampling import as_coordinates


def interpolation_gain(
    displacement: Float[Array, "... 2"], correlation: Float[Array, "... 2"] | float = 0.0
) -> Float[Array, "..."]:
    """Return the fraction of the variance of noise that remains after bilinear interpolation.

    Args:
        displacement: ``[..., 2]`` displacement ``(row, column)``, in pixels.
        correlation: ``[..., 2]`` correlation of the noise of neighbouring pixels ``(along a column,
            along a row)``. That of diagonal neighbours is taken to be the product.

    Returns:
        ``[...]`` gain; between 1/4 and 1 for independent noise.

    Example:
        >>> interpolation_gain(jnp.array([[0.0, 2.0], [0.5, 1.0], [0.5, 0.5]])).tolist()
        [1.0, 0.5, 0.25]
    """
    fraction = displacement - jax.lax.stop_gradient(jnp.floor(displacement))
    return (1 - 2 * fraction * (1 - fraction) * (1 - correlation)).prod(-1)


def expected_truncated_error(
    deviation: Float[Array, "*n"], truncation: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Compute the mean of ``min(|n|, truncation)`` for normally distributed n of mean zero.

    Args:
        deviation: ``[...]`` standard deviation of n, at least 0.
        truncation: ``[...]`` truncation, positive.

    Returns:
        ``[...]`` means.

    Example:
        >>> round(float(expected_truncated_error(jnp.array(1.0), jnp.array(9.0))), 4)  # sqrt(2/pi)
        0.7979
    """
    deviation = jnp.maximum(deviation, 1e-6 * truncation)
    ratio = truncation / deviation
    within = deviation * np.sqrt(2 / np.pi).item() * (1 - jnp.exp(-jnp.square(ratio) / 2))
    return within + truncation * jax.scipy.special.erfc(ratio / np.sqrt(2).item())


def noise_level(
    views: Float[Array, "v u h w"],
    candidates: Float[Array, " d"] | Float[Array, "d h w"],
    config: NoiseConfig,
    *,
    offsets: Float[Array, "v u 2"] | None = None,
) -> Float[Array, ""]:
    """Estimate the standard deviation of the noise of a view from the differences between views.

    The nearest views are compared with the centre view in windows; each window uses its best
    candidate. A low quantile over the windows leaves out occlusion and texture too fine to
    interpolate, which would look like noise. The gradient of the estimate is zero.

    Args:
        views: ``[v, u, h, w]`` grey views, h and w at least 2.
        candidates: ``[d]`` disparities, pixels per view step, or ``[d, h, w]`` disparity maps.
        config: Windows and quantile.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        Standard deviation, in grey levels; within about a tenth on natural images.

    Raises:
        InputError: If there is only one view.

    Example:
        >>> noise = 0.1 * jax.random.normal(jax.random.key(0), (3, 3, 64, 64))
        >>> round(float(noise_level(noise, jnp.zeros(1), NoiseConfig())), 1)
        0.1
    """
    v, u, h, w = views.shape
    views = jax.lax.stop_gradient(views)
    (candidates,) = as_coordinates(candidates)
    nearest, offsets = nearest_views(other_views((v, u), offsets))
    centre = views[centre_index((v, u))]

    def min_difference(neighbour):
        view, offset = neighbour

        def update(best, candidate):
            warped = warp_plane(view, jnp.broadcast_to(candidate, (h, w)), offset)
            # The variance of the difference is that of the centre view's noise plus what remains
            # of the other view's noise.
            displacement = jnp.stack([candidate * step for step in offset], axis=-1)
            deviation = jnp.sqrt(1 + interpolation_gain(displacement)).astype(views.dtype)
            difference = jnp.abs(warped - centre) / deviation
            return jnp.minimum(best, box_filter(difference, config.window_radius_px)), None

        return jax.lax.scan(update, jnp.full((h, w), jnp.inf, views.dtype), candidates)[0]

    differences = jax.lax.map(min_difference, (views.reshape(v * u, h, w)[nearest], offsets))
    # The mean absolute value of a normal distribution is sqrt(2 / pi) standard deviations.
    level = jnp.quantile(subsample(differences), config.quantile) * np.sqrt(np.pi / 2).item()
    return jax.lax.stop_gradient(level)


def noise_weight(level: Float[Array, ""], config: NoiseConfig) -> Float[Array, ""]:
    """Return how strongly noise, rather than other differences between views, affects the costs.

    Args:
        level: Standard deviation of the noise, in grey levels relative to the exposure's white.
        config: Reference level and steepness.

    Returns:
        Number in [0, 1], one half at the reference level.

    Example:
        >>> round(float(noise_weight(jnp.array(0.002), NoiseConfig(reference_level=0.002))), 3)
        0.5
    """
    return 1 - 1 / (1 + (level / config.reference_level) ** config.steepness)


def texture_weight(
    image: Float[Array, "h w"], level: Float[Array, ""], config: NoiseConfig
) -> Float[Array, "h w"]:
    """Return the fraction of the variance of an image's derivatives that is texture, not noise.

    In each window it is ``1 - margin * noise variance / variance``. The margin keeps the spread of
    the variance of pure noise from being taken for texture. Under little noise
    (:func:`noise_weight`) the weight is 1. The gradient of the weight is zero.

    Args:
        image: ``[h, w]`` grey image.
        level: Standard deviation of its noise, in grey levels relative to the exposure's white.
        config: Windows, margin and transition.

    Returns:
        ``[h, w]`` weights in [0, 1]; 1 without noise.

    Example:
        >>> noise = 0.1 * jax.random.normal(jax.random.key(0), (32, 32))
        >>> bool(texture_weight(noise, jnp.array(0.1), NoiseConfig()).mean() < 0.1)
        True
    """
    along_y, along_x = central_differences(jax.lax.stop_gradient(image))
    variance = box_filter(jnp.square(along_y) + jnp.square(along_x), config.window_radius_px)
    # A central difference, half of that of two pixels, has half the variance of the noise, so that
    # the sum of both has the variance of the noise.
    noise = config.texture_margin * jnp.square(level)
    texture = jnp.clip(1 - noise / jnp.maximum(variance, jnp.finfo(image.dtype).tiny), 0.0, 1.0)
    return jax.lax.stop_gradient(1 - noise_weight(level, config) * (1 - texture))


def subsample(maps: Float[Array, "*n h w"], max_size: int = 64) -> Float[Array, "*n i j"]:
    """Return every n-th row and column, at most ``max_size`` of each; enough for a quantile.

    Args:
        maps: ``[..., h, w]`` maps.
        max_size: Largest number of rows and of columns.

    Returns:
        ``[..., i, j]`` maps.

    Example:
        >>> subsample(jnp.zeros((4, 100, 200))).shape
        (4, 50, 50)
    """
    row_step, column_step = (-(-size // max_size) for size in maps.shape[-2:])
    return maps[..., ::row_step, ::column_step]
