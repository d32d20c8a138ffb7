"""Noise of the images: how strong it is, and what interpolation does to it.

A view read between pixels is an average of up to four of them, and so less noisy than one read at
whole pixels: of independent noise of variance s^2 the fraction ``interpolation_gain`` s^2 remains,
1 at whole pixels and 1/4 in the middle of four. Left alone, noise makes disparities that read
between pixels look like better matches.

Where the noise of neighbouring pixels is correlated, more remains.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.ops.aperture import views_around, views_beside
from occjax.ops.filtering import box_filter, central_differences
from occjax.ops.sampling import as_coordinates, warp_plane

WINDOW_RADIUS = 4
QUANTILE = 0.25

MARGIN = 1.3
"""Variance of derivatives that is taken for noise, as a multiple of that of noise."""

FAINT = 0.002
"""Standard deviation of noise, of grey, that is neither weak nor strong: twice what rounding to 8
bits makes of images without noise."""

ABRUPTNESS = 8
"""Power of its ratio to that by which noise counts: half of it is none, twice of it is all."""


def interpolation_gain(
    displacement: Float[Array, "... 2"], correlation: Float[Array, "... 2"] | float = 0.0
) -> Float[Array, "..."]:
    """Share of the variance of noise that bilinear interpolation leaves.

    Args:
        displacement: ``[..., 2]`` displacement ``(row, column)``, in pixels.
        correlation: ``[..., 2]`` correlation of the noise of neighbouring pixels ``(down a column,
            along a row)``; none by default. That of diagonal neighbours is taken to be the product.

    Returns:
        ``[...]`` gain; between 1/4 and 1 for independent noise.

    Example:
        >>> interpolation_gain(jnp.array([[0.0, 2.0], [0.5, 1.0], [0.5, 0.5]])).tolist()
        [1.0, 0.5, 0.25]
    """
    fraction = displacement - jax.lax.stop_gradient(jnp.floor(displacement))
    return (1 - 2 * fraction * (1 - fraction) * (1 - correlation)).prod(-1)


def expected_departure(
    deviation: Float[Array, "*n"], truncation: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Mean of ``min(|n|, truncation)`` for normally distributed n of mean zero.

    Args:
        deviation: ``[...]`` standard deviation of n, at least 0.
        truncation: ``[...]`` greatest absolute value counted, positive.

    Returns:
        ``[...]`` means.

    Example:
        >>> round(float(expected_departure(jnp.array(1.0), jnp.array(9.0))), 4)  # sqrt(2 / pi)
        0.7979
    """
    deviation = jnp.maximum(deviation, 1e-6 * truncation)
    ratio = truncation / deviation
    within = deviation * np.sqrt(2 / np.pi).item() * (1 - jnp.exp(-jnp.square(ratio) / 2))
    return within + truncation * jax.scipy.special.erfc(ratio / np.sqrt(2).item())


def noise_level(
    views: Float[Array, "v u h w"],
    candidates: Float[Array, " d"] | Float[Array, "d h w"],
    *,
    offsets: Float[Array, "v u 2"] | None = None,
) -> Float[Array, ""]:
    """Standard deviation of the noise of one view, from what is left of the views' differences.

    The views next to the centre one are compared with it over windows of 9x9 pixels; each window
    takes its best candidate. A low quantile over the windows leaves out occlusion and texture too
    fine to interpolate, which would pass for noise. No derivative passes through the estimate.

    Args:
        views: ``[v, u, h, w]`` grey views, h and w at least 2.
        candidates: ``[d]`` disparities, pixels per view step, or ``[d, h, w]`` maps of them.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        Standard deviation, in the unit of the views; within about a tenth on natural images.

    Raises:
        InputError: If there is no view beside the centre view.

    Example:
        >>> noise = 0.1 * jax.random.normal(jax.random.key(0), (3, 3, 64, 64))
        >>> round(float(noise_level(noise, jnp.zeros(1))), 1)
        0.1
    """
    v, u, h, w = views.shape
    views = jax.lax.stop_gradient(views)
    (candidates,) = as_coordinates(candidates)
    beside, offsets = views_beside(views_around((v, u), offsets))
    neighbours = views.reshape(v * u, h, w)[beside], offsets
    centre = views[v // 2, u // 2]

    def best_of(neighbour):
        view, offset = neighbour

        def least(best, candidate):
            warped = warp_plane(view, jnp.broadcast_to(candidate, (h, w)), offset)
            # The difference has the variance of the centre view's noise and of what remains here.
            displacement = jnp.stack([candidate * step for step in offset], axis=-1)
            gain = interpolation_gain(displacement)
            deviation = jnp.sqrt(1 + gain).astype(views.dtype)
            difference = box_filter(jnp.abs(warped - centre) / deviation, WINDOW_RADIUS)
            return jnp.minimum(best, difference), None

        return jax.lax.scan(least, jnp.full((h, w), jnp.inf, views.dtype), candidates)[0]

    # Of a normal distribution the mean absolute value is sqrt(2 / pi) standard deviations.
    means = jax.lax.map(best_of, neighbours)
    level = jnp.quantile(thinned(means), QUANTILE) * np.sqrt(np.pi / 2).item()
    return jax.lax.stop_gradient(level)


def noisiness(deviation: Float[Array, ""]) -> Float[Array, ""]:
    """How far noise, and not what else differs between views, limits what they tell.

    Args:
        deviation: Standard deviation of the noise of grey, the white of the centre view at about
            0.8, for example by :func:`noise_level`.

    Returns:
        Number in [0, 1], one half at :data:`FAINT`.

    Example:
        >>> round(float(noisiness(jnp.array(FAINT))), 3)
        0.5
    """
    return 1 - 1 / (1 + (deviation / FAINT) ** ABRUPTNESS)


def texture_share(image: Float[Array, "h w"], deviation: Float[Array, ""]) -> Float[Array, "h w"]:
    """How far the derivatives of an image, and its fine structure, are texture and not noise.

    In windows of 9x9 pixels: ``1 - noise / variance`` of the derivatives, a little less so that the
    spread of the variance of noise alone does not pass for texture. Under little noise
    (:func:`noisiness`) what there is of derivatives is worth more than what else views may have in
    common. No derivative passes through the shares.

    Args:
        image: ``[h, w]`` grey image, the white of the centre view at about 0.8.
        deviation: Standard deviation of its noise, for example by :func:`noise_level`.

    Returns:
        ``[h, w]`` shares in [0, 1]; 1 without noise.

    Example:
        >>> noise = 0.1 * jax.random.normal(jax.random.key(0), (32, 32))
        >>> bool(texture_share(noise, jnp.array(0.1)).mean() < 0.1)
        True
    """
    down, right = central_differences(jax.lax.stop_gradient(image))
    energy = box_filter(jnp.square(down) + jnp.square(right), WINDOW_RADIUS)
    # A central difference, half of that of two pixels, has half the variance; here are two.
    noise = jnp.square(deviation)
    little = jnp.finfo(image.dtype).tiny
    texture = jnp.clip(1 - MARGIN * noise / jnp.maximum(energy, little), 0.0, 1.0)
    return jax.lax.stop_gradient(1 - noisiness(deviation) * (1 - texture))


def thinned(maps: Float[Array, "*n h w"], most: int = 64) -> Float[Array, "*n i j"]:
    """Every n-th row and column, at most so many of each: enough for a quantile.

    Args:
        maps: ``[..., h, w]``.
        most: Rows and columns that are kept at most.

    Returns:
        ``[..., i, j]``.

    Example:
        >>> thinned(jnp.zeros((4, 100, 200))).shape
        (4, 50, 50)
    """
    down, right = (-(-size // most) for size in maps.shape[-2:])
    return maps[..., ::down, ::right]
