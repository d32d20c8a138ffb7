"""Filters of maps and of cost volumes.

* :func:`box_filter`, :func:`binomial_filter`: unweighted and weighted mean over a square window;
* :func:`central_differences`: derivatives;
* :func:`sample_at_offsets`: values at fixed offsets from each pixel;
* :func:`edge_aware_mean`: mean over a large neighbourhood that stops at edges;
* :func:`fit_planes`: weighted local planes, which follow slanted surfaces and stop at edges.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.kernels.padding import pad_borders

BINOMIAL = (np.poly1d([0.5, 0.5]) ** 8).coeffs
"""Weights of :func:`binomial_filter` along a row or a column."""

BINOMIAL_GAIN = np.square(BINOMIAL).sum().item()
"""Fraction of the standard deviation of independent noise that :func:`binomial_filter` leaves."""

BINOMIAL_CORRELATION = (BINOMIAL[1:] @ BINOMIAL[:-1]).item() / BINOMIAL_GAIN
"""Correlation of the remaining noise between neighbouring pixels."""


def box_filter(image: Float[Array, "*n h w"], radius: int) -> Float[Array, "*n h w"]:
    """Compute the mean over the ``(2 radius + 1)^2`` window of each pixel, borders replicated.

    Args:
        image: ``[..., h, w]`` map, or a stack of maps filtered one by one.
        radius: Radius of the window, in pixels; 0 returns the image.

    Returns:
        ``[..., h, w]`` means.

    Example:
        >>> box_filter(jnp.array([[0.0, 0.0, 3.0, 0.0, 0.0]]), 1)[0].tolist()
        [0.0, 1.0, 1.0, 1.0, 0.0]
    """
    if radius == 0:
        return image
    window = 2 * radius + 1
    # One division after both sums lets XLA fuse both passes.
    return _weighted_sums(image, [1.0] * window) * (1 / window**2)


def binomial_filter(image: Float[Array, "*n h w"]) -> Float[Array, "*n h w"]:
    """Compute the mean over 9x9 pixels with binomial weights, borders replicated.

    The weights approximate a normal distribution with a standard deviation of 1.4 pixels. Of the
    variance of independent noise ``BINOMIAL_GAIN ** 2`` remains, with the correlation
    ``BINOMIAL_CORRELATION`` between neighbouring pixels.

    Args:
        image: ``[..., h, w]`` map, or a stack of maps filtered one by one.

    Returns:
        ``[..., h, w]`` means.

    Example:
        >>> binomial_filter(jnp.zeros((1, 9)).at[0, 4].set(256.0))[0].tolist()
        [1.0, 8.0, 28.0, 56.0, 70.0, 56.0, 28.0, 8.0, 1.0]
    """
    return _weighted_sums(image, BINOMIAL.tolist())


def central_differences(
    image: Float[Array, "*n h w"],
) -> tuple[Float[Array, "*n h w"], Float[Array, "*n h w"]]:
    """Compute the derivatives along y and along x: half the difference of the two neighbours.

    Args:
        image: ``[..., h, w]`` map, or a stack of maps; borders are replicated.

    Returns:
        Two arrays ``[..., h, w]``: change per pixel downwards, and to the right.

    Example:
        >>> down, right = central_differences(jnp.array([[0.0, 2.0, 4.0], [1.0, 3.0, 5.0]]))
        >>> down[:, 1].tolist(), right[0].tolist()
        ([0.5, 0.5], [1.0, 2.0, 1.0])
    """
    padded = pad_borders(image, (1, 1), (1, 1))
    along_y = (padded[..., 2:, 1:-1] - padded[..., :-2, 1:-1]) / 2
    along_x = (padded[..., 1:-1, 2:] - padded[..., 1:-1, :-2]) / 2
    return along_y, along_x


def sample_at_offsets(
    image: Float[Array, "h w"], offsets: Sequence[tuple[int, int]]
) -> Float[Array, "n h w"]:
    """Return the values at fixed offsets from each pixel, borders replicated.

    Args:
        image: ``[h, w]`` map.
        offsets: Offsets ``(row, column)``, in pixels.

    Returns:
        ``[n, h, w]``, one map per offset.

    Example:
        >>> sample_at_offsets(jnp.arange(9.0).reshape(3, 3), [(-1, 0), (1, 1)])[:, 1, 1].tolist()
        [1.0, 8.0]
    """
    rows, columns = (
        np.clip(np.arange(size) + np.array(offsets)[:, axis, None], 0, size - 1)
        for axis, size in enumerate(image.shape)
    )
    # Slices of a padded image would take longer to compile and, if there are many, to run.
    return jax.vmap(lambda row, column: image[row][:, column])(rows, columns)


def surface_slopes(disparity: Float[Array, "h w"], step: int) -> Float[Array, "2 h w"]:
    """Return the slope of the surface at each pixel along rows and columns, per pixel.

    Of the slopes on both sides the smaller one is used, which at an edge is that of the surface
    itself, and zero where their signs differ.

    Args:
        disparity: ``[h, w]`` disparity map.
        step: Distance over which a slope is measured, in pixels.

    Example:
        >>> ramp = 0.5 * jnp.tile(jnp.arange(8.0), (8, 1))
        >>> surface_slopes(ramp, 2)[:, 4, 4].tolist()
        [0.0, 0.5]
    """
    slopes = []
    for axis, direction in enumerate(((step, 0), (0, step))):
        before, after = sample_at_offsets(disparity, [(-direction[0], -direction[1]), direction])
        slope_before, slope_after = (disparity - before) / step, (after - disparity) / step
        smaller = jnp.sign(slope_before) * jnp.minimum(jnp.abs(slope_before), jnp.abs(slope_after))
        slope = jnp.where(slope_before * slope_after > 0.0, smaller, 0.0)
        # At the border of the image there is a neighbour on one side only.
        size = disparity.shape[axis]
        position = jnp.expand_dims(jnp.arange(size), 1 - axis)
        slope = jnp.where(position >= size - step, slope_before, slope)
        slopes.append(jnp.where(position < step, slope_after, slope))
    return jnp.stack(slopes)


def edge_aware_mean(
    values: Float[Array, "n h w"],
    guides: Float[Array, "g h w"],
    *,
    radius: float,
    passes: int = 2,
) -> Float[Array, "n h w"]:
    """Compute the mean over the neighbourhood of each pixel; it does not reach across edges.

    The neighbourhood is that of :func:`fit_planes`. The time is O(n h w) for any radius.

    Args:
        values: ``[n, h, w]`` maps, for example a cost volume.
        guides: ``[g, h, w]`` maps whose edges are kept, each in units of the difference that counts
            as an edge.
        radius: Radius where there are no edges, in pixels.
        passes: Number of passes over rows and columns.

    Returns:
        ``[n, h, w]`` means.

    Example:
        >>> step = jnp.array([[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]])
        >>> noisy = step + jnp.array([[0.3, -0.3, 0.0, -0.3, 0.3, 0.0]])
        >>> means = edge_aware_mean(noisy[None], 100 * step[None], radius=50.0)[0]
        >>> bool(jnp.abs(means - step).max() < 0.05)
        True
    """
    with_weight = jnp.concatenate([values, jnp.ones_like(values[:1])])
    sums = _edge_aware_sums(jnp.moveaxis(with_weight, 0, 1), guides, radius, passes)
    sums = jnp.moveaxis(sums, 1, 0)
    return sums[:-1] / sums[-1:]


def fit_planes(
    values: Float[Array, "h w"],
    weights: Float[Array, "h w"],
    guides: Float[Array, "g h w"],
    *,
    radius: float,
    ridge: float = 1e-3,
    passes: int = 2,
) -> Float[Array, "h w"]:
    """Fit a plane to the weighted values around each pixel; it does not reach across edges.

    The neighbourhood is that of the domain transform (Gastal and Oliveira, Domain Transform for
    Edge-Aware Image and Video Processing, SIGGRAPH 2011): from pixel to pixel its weight falls by
    ``exp(-sqrt(2) (1 / radius + sum_g |difference of guide g|))``, first along columns, then along
    rows. A plane, unlike an average, does not flatten slanted surfaces, even if the weights are
    uneven. The time is O(h w) for any radius.

    Args:
        values: ``[h, w]`` values, for example a noisy disparity map.
        weights: ``[h, w]`` positive weight of each value, for example its inverse variance.
        guides: ``[g, h, w]`` maps whose edges are kept, each in units of the difference that counts
            as an edge.
        radius: Radius where there are no edges, in pixels.
        ridge: Regularisation of the slopes towards zero, as a variance of position in units of
            (64 pixels)^2.
        passes: Number of passes over rows and columns, each with half the radius of the one before.
            More passes leave fewer stripes along the axes.

    Returns:
        ``[h, w]`` height of each pixel's plane at the pixel.

    Example:
        >>> ramp = jnp.tile(jnp.linspace(0.0, 1.0, 9), (9, 1))
        >>> flat = fit_planes(ramp, jnp.ones((9, 9)), jnp.zeros((0, 9, 9)), radius=4.0, ridge=0.0)
        >>> bool(jnp.abs(flat - ramp).max() < 1e-3)
        True
    """
    h, w = values.shape
    unit = 64.0  # keeps the second moments close to 1
    y = (jnp.arange(h, dtype=values.dtype) - h / 2)[:, None] / unit * jnp.ones_like(values)
    x = (jnp.arange(w, dtype=values.dtype) - w / 2)[None, :] / unit * jnp.ones_like(values)
    products = [jnp.ones_like(x), x, y, x * x, x * y, y * y, values, values * x, values * y]
    # The axis of the moments is between rows and columns. Rows that are added are then contiguous,
    # and one copy between two passes is enough.
    moments = jnp.stack([product * weights for product in products], axis=1)
    moments = _edge_aware_sums(moments, guides, radius, passes)
    moments = jnp.moveaxis(moments, 1, 0)
    _, x_mean, y_mean, xx, xy, yy, mean, x_value, y_value = moments / moments[:1]
    xx = jnp.maximum(xx - x_mean * x_mean, 0.0) + ridge
    yy = jnp.maximum(yy - y_mean * y_mean, 0.0) + ridge
    xy = xy - x_mean * y_mean
    x_value, y_value = x_value - x_mean * mean, y_value - y_mean * mean
    determinant = jnp.maximum(xx * yy - xy * xy, 1e-12)
    slope_x = (x_value * yy - y_value * xy) / determinant
    slope_y = (y_value * xx - x_value * xy) / determinant
    return mean + slope_x * (x - x_mean) + slope_y * (y - y_mean)


def _weighted_sums(image: Array, weights: Sequence[float]) -> Array:
    """Sum over a window of odd size, with the same weights along rows and columns.

    A sum of slices fuses into one pass over memory; differences of running sums would lose
    precision.
    """
    radius = len(weights) // 2
    # One padding for both axes: an operation between the two sums would break their fusion.
    sums = pad_borders(image, (radius, radius), (radius, radius))
    for axis in (image.ndim - 2, image.ndim - 1):
        size = image.shape[axis]
        slices = (
            jax.lax.slice_in_dim(sums, start, start + size, axis=axis)
            for start in range(len(weights))
        )
        terms = (
            term if weight == 1.0 else weight * term
            for weight, term in zip(weights, slices, strict=True)
        )
        sums = functools.reduce(jnp.add, terms)
    return sums


def _edge_aware_sums(
    rows: Float[Array, "h m w"], guides: Float[Array, "g h w"], radius: float, passes: int
) -> Float[Array, "h m w"]:
    """Sum over the neighbourhood of each pixel, up to the edges of the guides."""
    along_rows, along_columns = (
        jnp.sqrt(2.0).astype(rows.dtype)
        * (1 / radius + jnp.abs(jnp.diff(guides, axis=axis)).sum(0))
        for axis in (2, 1)
    )

    def add(rows, factor):
        rows = _decaying_sums(rows, jnp.exp(-factor * along_columns)).T
        return _decaying_sums(rows, jnp.exp(-factor * along_rows).T).T, None

    # A loop in Python would be compiled once per pass.
    factors = 2.0 ** jnp.arange(passes, dtype=rows.dtype)
    return jax.lax.scan(add, rows, factors)[0]


def _decaying_sums(
    rows: Float[Array, "h m w"], decay: Float[Array, "i w"]
) -> Float[Array, "h m w"]:
    """Sum along each column in both directions; ``decay`` ``[h - 1, w]`` is the factor per row."""
    return jax.lax.platform_dependent(rows, decay, cpu=_scan_rows, default=_scan_halves)


def _scan_rows(rows: Array, decay: Array) -> Array:
    zero = jnp.zeros_like(rows[:1, 0])

    def down(carried, here):
        row, decay = here
        carried = row + decay[None] * carried
        return carried, carried

    # The sum of both directions is taken inside the loop: after it, XLA would fuse it with a
    # transposition, which then reads three arrays column by column.
    def up(carried, here):
        row, decay, above = here
        carried = row + decay[None] * carried
        return carried, above + (carried - row)

    start = jnp.zeros_like(rows[0])
    above = jax.lax.scan(down, start, (rows, jnp.concatenate([zero, decay])))[1]
    return jax.lax.scan(up, start, (rows, jnp.concatenate([decay, zero]), above), reverse=True)[1]


def _scan_halves(rows: Array, decay: Array) -> Array:
    """Compute the same in log2(h) steps, for devices with many processors.

    On a CPU it takes nearly four times as long.
    """
    zero = jnp.zeros_like(rows[:1, 0])

    def combine(first, second):
        (first_decay, total), (second_decay, added) = first, second
        return first_decay * second_decay, added + second_decay * total

    def carried(decay, *, reverse):
        decay = jnp.broadcast_to(decay[:, None], rows.shape)
        return jax.lax.associative_scan(combine, (decay, rows), reverse=reverse)[1]

    down = carried(jnp.concatenate([zero, decay]), reverse=False)
    up = carried(jnp.concatenate([decay, zero]), reverse=True)
    return down + (up - rows)
