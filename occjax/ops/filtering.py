"""Edge-aware aggregation of cost volumes and maps, guided by an image.

* :func:`box_filter`: plain means over a square window;
* :func:`guided_filter`: local, keeps the edges of the guide (He, Sun, Tang, Guided Image Filtering,
  TPAMI 2013);
* :func:`semi_global`: carries evidence across whole untextured regions (Hirschmueller, Stereo
  Processing by Semiglobal Matching and Mutual Information, TPAMI 2008).
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def box_filter(image: Float[Array, "*n h w"], radius: int) -> Float[Array, "*n h w"]:
    """Mean over the ``(2 radius + 1)^2`` window of each pixel, borders replicated.

    Args:
        image: ``[..., h, w]`` map, or a stack of maps filtered one by one.
        radius: Radius of the window, in pixels; 0 returns the image.

    Returns:
        ``[..., h, w]`` means.

    Example:
        >>> box_filter(jnp.array([[0.0, 0.0, 3.0, 0.0, 0.0]]), 1)[0].tolist()
        [0.0, 1.0, 1.0, 1.0, 0.0]
    """
    for axis in (image.ndim - 2, image.ndim - 1):
        image = _running_mean(image, radius, axis)
    return image


def guided_filter(
    image: Float[Array, "*n h w"],
    guide: Float[Array, "h w"],
    *,
    radius: int,
    epsilon: float,
) -> Float[Array, "*n h w"]:
    """Smooth an image except across the edges of a guide.

    In each window the result is the affine function ``a * guide + b`` that fits the image best,
    with ``a = cov(guide, image) / (var(guide) + epsilon)``; a pixel averages the functions of the
    windows that contain it. Where the guide varies by much less than ``sqrt(epsilon)`` this is two
    box filters; across stronger edges of the guide it does not smooth.

    Args:
        image: ``[..., h, w]`` map, or a stack of maps (a cost volume) filtered one by one.
        guide: ``[h, w]`` image whose edges are kept.
        radius: Radius of the windows, in pixels.
        epsilon: Variance of the guide that counts as flat, in squared units of the guide.

    Returns:
        ``[..., h, w]`` filtered image.

    Example:
        >>> step = jnp.repeat(jnp.array([0.0, 1.0]), 8)[None]
        >>> bool(jnp.abs(guided_filter(step, step, radius=2, epsilon=1e-4) - step).max() < 1e-2)
        True
    """
    mean = box_filter(guide, radius)
    # The guide's own mean is taken out: in float32 mean(g^2) - mean(g)^2 loses small variances.
    centred = guide - guide.mean()
    centred_mean = mean - guide.mean()
    variance = box_filter(centred * centred, radius) - centred_mean * centred_mean

    def one(plane: Array) -> Array:
        plane_mean = box_filter(plane, radius)
        covariance = box_filter(centred * plane, radius) - centred_mean * plane_mean
        slope = covariance / (variance + epsilon)
        intercept = plane_mean - slope * centred_mean
        return box_filter(slope, radius) * centred + box_filter(intercept, radius)

    planes = image.reshape(-1, *guide.shape)
    return jax.lax.map(one, planes).reshape(image.shape)


def semi_global(
    costs: Float[Array, "d h w"],
    guide: Float[Array, "h w"],
    *,
    small_penalty: Float[Array, ""] | float,
    large_penalty: Float[Array, ""] | float,
    guide_scale: float,
) -> Float[Array, "d h w"]:
    """Aggregate a cost volume along eight straight paths into each pixel.

    The cost of candidate k at pixel p along a path is its own cost plus the cheapest way to come
    from the pixel q before::

        L(p, k) = C(p, k) - min L(q)
                + min(L(q, k), L(q, k - 1) + P1, L(q, k + 1) + P1, min L(q) + P2)

    with ``P2 = max(P1, large_penalty * exp(-|guide(p) - guide(q)| / guide_scale))``: disparity may
    jump where the guide does. The result is the mean over the paths, so its scale is that of the
    costs accumulated over a neighbourhood. Time is O(d h w) and memory that of a few volumes.

    Args:
        costs: ``[d, h, w]`` cost of each candidate, candidates in increasing order.
        guide: ``[h, w]`` image of the centre view.
        small_penalty: P1, for a step to a neighbouring candidate (slanted surfaces).
        large_penalty: Upper bound of P2, for any larger step (depth edges).
        guide_scale: Difference of the guide over which P2 falls by a factor e.

    Returns:
        ``[d, h, w]`` aggregated costs.

    Example:
        >>> noisy = jnp.array([[0.0, 0.0, 0.3, 0.0, 0.0], [0.2, 0.2, 0.2, 0.2, 0.2]])[:, None]
        >>> smooth = semi_global(
        ...     noisy, jnp.zeros((1, 5)), small_penalty=0.5, large_penalty=1.0, guide_scale=0.1
        ... )
        >>> noisy.argmin(0)[0].tolist(), smooth.argmin(0)[0].tolist()
        ([0, 0, 1, 0, 0], [0, 0, 0, 0, 0])
    """
    small = jnp.asarray(small_penalty, costs.dtype)
    large = jnp.asarray(large_penalty, costs.dtype)
    by_row, by_column = jnp.moveaxis(costs, 0, 1), jnp.moveaxis(costs, 2, 0)
    total = jnp.zeros_like(by_row)
    for slope in (0, 1, -1):
        for reverse in (False, True):
            total = total + _along_rows(by_row, guide, small, large, guide_scale, slope, reverse)
    total = jnp.moveaxis(total, 1, 0)
    for reverse in (False, True):
        path = _along_rows(by_column, guide.T, small, large, guide_scale, 0, reverse)
        total = total + jnp.moveaxis(path, 0, 2)
    return total / 8


def _running_mean(image: Array, radius: int, axis: int) -> Array:
    """Mean of the ``2 radius + 1`` neighbours along one axis.

    A matrix product with a band of ones: one call for any radius, where sums of slices grow with
    the radius and differences of running sums lose precision.
    """
    size = image.shape[axis]
    positions = jnp.clip(
        jnp.arange(size)[:, None] + jnp.arange(-radius, radius + 1)[None, :], 0, size - 1
    )
    band = jax.nn.one_hot(positions, size, dtype=image.dtype).mean(1)
    product = jnp.tensordot(image, band, ((axis,), (1,)), precision="highest")
    return jnp.moveaxis(product, -1, axis)


def _along_rows(
    costs: Array,
    guide: Array,
    small: Array,
    large: Array,
    guide_scale: float,
    slope: int,
    reverse: bool,
) -> Array:
    """Path costs ``[y, d, x]`` of paths that move one row, and ``slope`` columns, at each step."""
    beyond = jnp.full((1, costs.shape[2]), jnp.inf, costs.dtype)

    def step(before, here):
        path, guide_before = before
        cost, guide_here = here
        if slope:
            # A path that enters through the image's side starts there, with nothing accumulated.
            entry = 0 if slope > 0 else -1
            path = jnp.roll(path, slope, axis=1).at[:, entry].set(0.0)
            guide_before = jnp.roll(guide_before, slope)
        jump = jnp.maximum(
            small, large * jnp.exp(-jnp.abs(guide_here - guide_before) / guide_scale)
        )
        cheapest = path.min(0, keepdims=True)
        neighbour = jnp.minimum(
            jnp.concatenate([path[1:], beyond]), jnp.concatenate([beyond, path[:-1]])
        )
        arrival = jnp.minimum(jnp.minimum(path, neighbour + small), cheapest + jump[None])
        path = cost + arrival - cheapest
        return (path, guide_here), path

    start = (jnp.zeros_like(costs[0]), guide[-1] if reverse else guide[0])
    return jax.lax.scan(step, start, (costs, guide), reverse=reverse)[1]
