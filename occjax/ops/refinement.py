"""Sub-pixel refinement of a disparity map from all views at once.

One step linearises every view around the present disparity d (Lucas, Kanade, IJCAI 1981). With the
residual ``r_k = feature_k(warped by d) - feature_centre`` and its derivative
``g_k = -offset_k . gradient(feature_centre)``, the views agree best at ``d + b / a`` where::

    a = sum_k w_k g_k^2        b = -sum_k w_k g_k r_k

``a`` is also the information of that pixel, the inverse variance of its disparity up to the noise:
large on texture, nothing on a blank wall. Planes fitted with these weights therefore let textured
pixels speak for their untextured neighbours, up to the edges of image and disparity.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.ops.aperture import views_around, views_beside
from occjax.ops.filtering import (
    box_filter,
    central_differences,
    fit_planes,
)
from occjax.ops.noise import noise_level, thinned
from occjax.ops.sampling import as_images, warp_plane

GREY_CHANGE = 0.01
"""Standard deviation of grey from view to view that is neither noise nor disparity."""


def refine_disparity(
    features: Float[Array, "v u h w c"],
    disparity: Float[Array, "h w"],
    guide: Float[Array, "h w"],
    *,
    offsets: Float[Array, "v u 2"] | None = None,
    steps: int = 2,
    largest_step: Float[Array, ""] | float = 0.1,
    radius: float = 8.0,
    guide_edge: float = 0.03,
    disparity_edge: float = 0.15,
) -> Float[Array, "h w"]:
    """Refine a disparity map by information-weighted planes through multi-view Lucas-Kanade steps.

    The weight of a view, ``w_k = exp(-r^2 / noise)`` with r^2 the mean of squared residuals in a
    3x3 window, silences views in which the point is occluded or glossy; the noise is the median of
    r^2 in the views next to the centre view.

    Args:
        features: ``[v, u, h, w, c]`` views or features of them, h and w at least 2.
        disparity: ``[h, w]`` disparity of the centre view, right to a fraction of a pixel.
        guide: ``[h, w]`` grey image of the centre view.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.
        steps: Number of Lucas-Kanade steps.
        largest_step: Bound of each step, in pixels per view step.
        radius: Reach of the planes in the absence of edges, in pixels.
        guide_edge: Difference of the guide that bounds a plane, as far as ``radius`` does.
        disparity_edge: Difference of disparity that bounds a plane likewise.

    Returns:
        ``[h, w]`` refined disparity.

    Raises:
        InputError: If there is no view beside the centre view, or for integer features.

    Example:
        >>> ramp = jnp.tile(jnp.arange(8.0)[None, :, None], (8, 1, 1))
        >>> views = jnp.stack([ramp - 1.0, ramp, ramp + 1.0])[None]  # disparity 1
        >>> refined = refine_disparity(views, jnp.full((8, 8), 0.95), jnp.zeros((8, 8)))
        >>> round(float(refined[4, 4]), 2)
        1.0
    """
    features = as_images(features, "v u h w c", "features")
    v, u, h, w, c = features.shape
    around = views_around((v, u), offsets)
    stack = jnp.moveaxis(features.reshape(v * u, h, w, c), -1, 1)
    others, centre = stack[around.view], stack[around.centre]
    gradients_y, gradients_x = central_differences(centre)
    smooth_guide = box_filter(guide, 1)  # noise of the guide is no edge
    beside, nearest = views_beside(around)
    nothing = jnp.zeros_like(centre[0])

    def residual(feature, offset, disparity):
        warped = [warp_plane(plane, disparity, offset) for plane in feature]
        differences = [plane - here for plane, here in zip(warped, centre, strict=True)]
        return differences, box_filter(sum(map(jnp.square, differences), nothing), 1)

    def step(disparity, _):
        near = jax.lax.map(lambda view: residual(*view, disparity)[1], (stack[beside], nearest))
        noise = jnp.maximum(jax.lax.stop_gradient(jnp.median(thinned(near))), 1e-8)

        @jax.checkpoint
        def add_view(sums, view):
            feature, offset = view
            differences, squared = residual(feature, offset, disparity)
            weight = jnp.exp(-squared / noise)
            down, right = offset.astype(centre.dtype)
            information, push = sums
            for difference, along_y, along_x in zip(
                differences, gradients_y, gradients_x, strict=True
            ):
                derivative = -(down * along_y + right * along_x)
                information = information + weight * jnp.square(derivative)
                push = push - weight * derivative * difference
            return (information, push), None

        (information, push), _ = jax.lax.scan(add_view, (nothing, nothing), (others, around.offset))
        # As if each view had a gradient of 0.1 %: blank pixels stay, and planes have some weight.
        prior = 1e-6 * len(stack)
        update = jnp.clip(push / (information + prior), -largest_step, largest_step)
        edges = jnp.stack([smooth_guide / guide_edge, disparity / disparity_edge])
        planes = fit_planes(disparity + update, information + 0.01 * prior, edges, radius=radius)
        return planes, None

    return jax.lax.scan(step, disparity, None, length=steps)[0]


def refinement_features(
    views: Float[Array, "v u h w"],
    disparity: Float[Array, "h w"],
    *,
    offsets: Float[Array, "v u 2"] | None = None,
) -> Float[Array, "v u h w 3"]:
    """Derivatives of grey, and grey itself as far as noise hides them: for refinement.

    Without noise derivatives tell more, since they do not see vignetting and the broad part of
    highlights. Noise spoils them first: it is fine, and much of what is left on a blank wall is
    broad. So grey counts by the ratio of the variances, that of a derivative being the noise's and
    that of grey the noise's and GREY_CHANGE's.

    Args:
        views: ``[v, u, h, w]`` grey views, the white of the centre view at about 0.8.
        disparity: ``[h, w]`` disparity of the centre view, by which the noise is found.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        ``[v, u, h, w, 3]`` for :func:`refine_disparity`.

    Raises:
        InputError: If there is no view beside the centre view, or for integer views.

    Example:
        >>> refinement_features(jnp.zeros((3, 3, 4, 6)), jnp.zeros((4, 6))).shape
        (3, 3, 4, 6, 3)
    """
    views = as_images(views, "v u h w")
    variance = jnp.square(noise_level(views, disparity[None], offsets=offsets))
    # A central difference, half of that of two pixels, has half the variance.
    share = variance / 2 / (variance + GREY_CHANGE**2)
    return jnp.stack([*central_differences(views), jnp.sqrt(share) * views], axis=-1)


def median_filter(image: Float[Array, "h w"]) -> Float[Array, "h w"]:
    """Median of the 3x3 pixels around each, borders replicated: takes out single wrong pixels.

    Args:
        image: ``[h, w]`` map.

    Returns:
        ``[h, w]`` medians.

    Example:
        >>> float(median_filter(jnp.zeros((5, 5)).at[2, 2].set(9.0)).max())
        0.0
    """
    padded = jnp.pad(image, 1, mode="edge")
    low, middle, high = _sorted(padded[:-2], padded[1:-1], padded[2:])
    # Of three sorted columns the median is that of these three.
    largest_low = functools.reduce(jnp.maximum, _beside(low))
    middle_middle = _sorted(*_beside(middle))[1]
    smallest_high = functools.reduce(jnp.minimum, _beside(high))
    return _sorted(largest_low, middle_middle, smallest_high)[1]


def _sorted(one: Array, two: Array, three: Array) -> tuple[Array, Array, Array]:
    """Three arrays, element by element in ascending order."""
    one, two = jnp.minimum(one, two), jnp.maximum(one, two)
    two, three = jnp.minimum(two, three), jnp.maximum(two, three)
    one, two = jnp.minimum(one, two), jnp.maximum(one, two)
    return one, two, three


def _beside(padded: Array) -> tuple[Array, Array, Array]:
    """Each column's neighbour to the left, itself, the one to the right."""
    return padded[:, :-2], padded[:, 1:-1], padded[:, 2:]
