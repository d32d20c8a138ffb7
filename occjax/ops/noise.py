"""Noise of the images: how strong it is, and what interpolation does to it.

A view read between pixels is an average of up to four of them, and so less noisy than one read at
whole pixels: of independent noise of variance s^2 the fraction ``interpolation_gain`` s^2 remains,
1 at whole pixels and 1/4 in the middle of four. Left alone, noise makes disparities that read
between pixels look like better matches.

Where neighbouring pixels are alike, more remains; :func:`blank_correlation` says how alike they are
where there is little but noise.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.ops.aperture import views_around, views_beside
from occjax.ops.filtering import box_filter
from occjax.ops.sampling import as_coordinates, warp_plane

WINDOW_RADIUS = 4
QUANTILE = 0.25
BLANK_QUANTILE = 0.35


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


def blank_correlation(image: Float[Array, "h w"]) -> Float[Array, " 2"]:
    """Correlation of neighbouring pixels in the blankest windows of an image.

    Windows of 9x9 pixels, the third of them with the least variance, each without its own mean. It
    is that of the noise and of whatever faint texture there is, for that is what differs there
    between views that do not match. No derivative passes through it.

    Args:
        image: ``[h, w]`` image, or a feature of it.

    Returns:
        ``[2]`` correlation ``(down a column, along a row)`` in [0, 1].

    Example:
        >>> noise = jax.random.normal(jax.random.key(0), (128, 129))
        >>> blurred = noise[:, 1:] + noise[:, :-1]
        >>> [round(float(number), 1) for number in blank_correlation(blurred)]
        [0.0, 0.5]
    """
    image = jax.lax.stop_gradient(image)
    rounding = jnp.square(4 * jnp.finfo(image.dtype).eps * image).sum()
    image = image - box_filter(image, WINDOW_RADIUS)
    variance = box_filter(jnp.square(image), WINDOW_RADIUS)
    blank = variance <= jnp.quantile(thinned(variance), BLANK_QUANTILE)
    # Of one size, so that all sums are over the same pixels.
    here = jnp.where(blank, image, 0.0)[:-1, :-1]
    square, below, right = (
        (here * there).sum() for there in (here, image[1:, :-1], image[:-1, 1:])
    )
    known = square > rounding
    correlation = jnp.stack([below, right]) / jnp.where(known, square, 1.0)
    return jnp.where(known, jnp.clip(correlation, 0.0, 1.0), 0.0)


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
