"""Smoothing of maps and cost volumes.

* :func:`box_filter`, :func:`binomial_filter`: plain and weighted means over a square window;
* :func:`edge_aware_mean`: means over large surroundings, which stop at edges;
* :func:`fit_planes`: weighted local planes, which follow slanted surfaces and stop at edges;
* :func:`central_differences`: derivatives, the opposite of smoothing;
* :func:`neighbours`: the values around a pixel, for filters of any other kind.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

BINOMIAL = (np.poly1d([0.5, 0.5]) ** 8).coeffs
"""Weights of :func:`binomial_filter` along a row or a column."""

BINOMIAL_GAIN = np.square(BINOMIAL).sum().item()
"""Share of the standard deviation of independent noise that it leaves."""

BINOMIAL_CORRELATION = (BINOMIAL[1:] @ BINOMIAL[:-1]).item() / BINOMIAL_GAIN
"""Correlation of that noise from pixel to pixel."""


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
    if radius == 0:
        return image
    padding = [(0, 0)] * (image.ndim - 2) + [(radius, radius)] * 2
    # Padded once for both axes: what stands between the two sums would break their fusion.
    sums = jnp.pad(image, padding, mode="edge")
    for axis in (image.ndim - 2, image.ndim - 1):
        sums = _running_sum(sums, 2 * radius + 1, axis)
    return sums * (1 / (2 * radius + 1) ** 2)


def binomial_filter(image: Float[Array, "*n h w"]) -> Float[Array, "*n h w"]:
    """Mean over 9x9 pixels weighted by binomial coefficients, borders replicated.

    Nearly a normal distribution, of a standard deviation of 1.4 pixels. Of the variance of
    independent noise ``BINOMIAL_GAIN ** 2`` is left, with the correlation ``BINOMIAL_CORRELATION``
    from pixel to pixel.

    Args:
        image: ``[..., h, w]`` map, or a stack of maps filtered one by one.

    Returns:
        ``[..., h, w]`` means.

    Example:
        >>> binomial_filter(jnp.zeros((1, 9)).at[0, 4].set(256.0))[0].tolist()
        [1.0, 8.0, 28.0, 56.0, 70.0, 56.0, 28.0, 8.0, 1.0]
    """
    radius = len(BINOMIAL) // 2
    padding = [(0, 0)] * (image.ndim - 2) + [(radius, radius)] * 2
    sums = jnp.pad(image, padding, mode="edge")
    for axis in (image.ndim - 2, image.ndim - 1):
        size = image.shape[axis]
        slices = (
            weight.item() * jax.lax.slice_in_dim(sums, k, k + size, axis=axis)
            for k, weight in enumerate(BINOMIAL)
        )
        sums = functools.reduce(jnp.add, slices)
    return sums


def central_differences(
    image: Float[Array, "*n h w"],
) -> tuple[Float[Array, "*n h w"], Float[Array, "*n h w"]]:
    """Derivatives along y and along x: half the difference of the two neighbours.

    Args:
        image: ``[..., h, w]`` map, or a stack of maps; borders are replicated.

    Returns:
        Two arrays ``[..., h, w]``: per pixel downwards, and per pixel to the right.

    Example:
        >>> down, right = central_differences(jnp.array([[0.0, 2.0, 4.0], [1.0, 3.0, 5.0]]))
        >>> down[:, 1].tolist(), right[0].tolist()
        ([0.5, 0.5], [1.0, 2.0, 1.0])
    """
    padded = jnp.pad(image, [(0, 0)] * (image.ndim - 2) + [(1, 1), (1, 1)], mode="edge")
    along_y = (padded[..., 2:, 1:-1] - padded[..., :-2, 1:-1]) / 2
    along_x = (padded[..., 1:-1, 2:] - padded[..., 1:-1, :-2]) / 2
    return along_y, along_x


def neighbours(
    image: Float[Array, "h w"], places: Sequence[tuple[int, int]]
) -> Float[Array, "n h w"]:
    """The values some pixels away from each pixel, borders replicated.

    Args:
        image: ``[h, w]`` map.
        places: How far away, ``(rows, columns)``.

    Returns:
        ``[n, h, w]``, one map for each place.

    Example:
        >>> neighbours(jnp.arange(9.0).reshape(3, 3), [(-1, 0), (1, 1)])[:, 1, 1].tolist()
        [1.0, 8.0]
    """
    h, w = image.shape
    rows, columns = (
        np.clip(np.arange(size) + np.array([place[axis] for place in places])[:, None], 0, size - 1)
        for axis, size in enumerate((h, w))
    )
    # By numbers: slices of a padded image take longer to compile and, many of them, to run.
    return jax.vmap(lambda row, column: image[row][:, column])(rows, columns)


def edge_aware_mean(
    values: Float[Array, "n h w"],
    guides: Float[Array, "g h w"],
    *,
    radius: float,
    passes: int = 2,
) -> Float[Array, "n h w"]:
    """Mean over the surroundings of each pixel, not reaching across edges.

    The surroundings are those of :func:`fit_planes`. Time is O(n h w), whatever the radius.

    Args:
        values: ``[n, h, w]`` maps, for example a cost volume.
        guides: ``[g, h, w]`` maps whose edges are kept, each in units of the difference that counts
            as an edge.
        radius: Reach in the absence of edges, in pixels.
        passes: Times the surroundings are grown over rows and columns.

    Returns:
        ``[n, h, w]`` means.

    Example:
        >>> step = jnp.array([[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]])
        >>> noisy = step + jnp.array([[0.3, -0.3, 0.0, -0.3, 0.3, 0.0]])
        >>> means = edge_aware_mean(noisy[None], 100 * step[None], radius=50.0)[0]
        >>> bool(jnp.abs(means - step).max() < 0.05)
        True
    """
    weighed = jnp.concatenate([values, jnp.ones_like(values[:1])])
    sums = _gathered(jnp.moveaxis(weighed, 0, 1), guides, radius, passes)
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
    """Fit a plane to the weighted values around each pixel, not reaching across edges.

    The neighbourhood is that of the domain transform (Gastal, Oliveira, Domain Transform for
    Edge-Aware Image and Video Processing, SIGGRAPH 2011): from pixel to neighbouring pixel its
    weight falls by ``exp(-sqrt(2) (1 / radius + sum_g |difference of guide g|))``, along columns,
    then along rows. Unlike an average, a plane does not flatten slanted surfaces, however unevenly
    the weights lie. Time is O(h w), whatever the radius.

    Args:
        values: ``[h, w]`` values, for example a noisy disparity map.
        weights: ``[h, w]`` positive weight of each value, for example its inverse variance.
        guides: ``[g, h, w]`` maps whose edges are kept, each in units of the difference that counts
            as an edge.
        radius: Reach in the absence of edges, in pixels.
        ridge: Draws the slopes to zero where the values say little about them: the variance of
            position, in units of (64 pixels)^2, that does as much.
        passes: Times the neighbourhood is grown over rows and columns, each by half the last
            radius; more leave fewer stripes along the axes.

    Returns:
        ``[h, w]`` height of each pixel's plane at the pixel.

    Example:
        >>> ramp = jnp.tile(jnp.linspace(0.0, 1.0, 9), (9, 1))
        >>> flat = fit_planes(ramp, jnp.ones((9, 9)), jnp.zeros((0, 9, 9)), radius=4.0, ridge=0.0)
        >>> bool(jnp.abs(flat - ramp).max() < 1e-3)
        True
    """
    h, w = values.shape
    unit = 64.0  # keeps the second moments near one
    y = (jnp.arange(h, dtype=values.dtype) - h / 2)[:, None] / unit * jnp.ones_like(values)
    x = (jnp.arange(w, dtype=values.dtype) - w / 2)[None, :] / unit * jnp.ones_like(values)
    products = [jnp.ones_like(x), x, y, x * x, x * y, y * y, values, values * x, values * y]
    # Rows before moments before columns, or the other way round: what a row is added to lies beside
    # it, and between two passes there is but one copy.
    moments = jnp.stack([product * weights for product in products], axis=1)
    moments = _gathered(moments, guides, radius, passes)
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


def _gathered(
    rows: Float[Array, "h m w"], guides: Float[Array, "g h w"], radius: float, passes: int
) -> Float[Array, "h m w"]:
    """Sums over the surroundings of each pixel, as far as the guides have no edges."""
    along_rows, along_columns = (
        jnp.sqrt(2.0).astype(rows.dtype)
        * (1 / radius + jnp.abs(jnp.diff(guides, axis=axis)).sum(0))
        for axis in (2, 1)
    )
    for pass_ in range(passes):
        rows = _spread(rows, jnp.exp(-(2**pass_) * along_columns)).T
        rows = _spread(rows, jnp.exp(-(2**pass_) * along_rows).T).T
    return rows


def _running_sum(image: Array, window: int, axis: int) -> Array:
    """Sums of so many values along one axis; shorter than the image by one less.

    A sum of slices, which fuse into one pass; differences of running sums would lose precision.
    """
    size = image.shape[axis] - window + 1
    slices = (jax.lax.slice_in_dim(image, k, k + size, axis=axis) for k in range(1, window))
    return sum(slices, jax.lax.slice_in_dim(image, 0, size, axis=axis))


def _spread(rows: Float[Array, "h m w"], keep: Float[Array, "i w"]) -> Float[Array, "h m w"]:
    """Sum over each column, a value fading by ``keep``, ``[h - 1, w]``, from a row to the next."""
    return jax.lax.platform_dependent(rows, keep, cpu=_row_by_row, default=_by_halves)


def _row_by_row(rows: Array, keep: Array) -> Array:
    none = jnp.zeros_like(rows[:1, 0])

    def down(carried, here):
        row, kept = here
        carried = row + kept[None] * carried
        return carried, carried

    # The sum is taken within the loop: behind it, XLA would fuse it with a transposition, which
    # then reads three arrays column by column.
    def up(carried, here):
        row, kept, above = here
        carried = row + kept[None] * carried
        return carried, above + (carried - row)

    start = jnp.zeros_like(rows[0])
    above = jax.lax.scan(down, start, (rows, jnp.concatenate([none, keep])))[1]
    return jax.lax.scan(up, start, (rows, jnp.concatenate([keep, none]), above), reverse=True)[1]


def _by_halves(rows: Array, keep: Array) -> Array:
    """The same in as many steps as the height can be halved, for devices with many processors.

    On a CPU nearly four times as slow.
    """
    none = jnp.zeros_like(rows[:1, 0])

    def then(first, second):
        (faded, total), (fading, added) = first, second
        return faded * fading, added + fading * total

    def carried(rows, keep, *, reverse):
        kept = jnp.broadcast_to(keep[:, None], rows.shape)
        return jax.lax.associative_scan(then, (kept, rows), reverse=reverse)[1]

    down = carried(rows, jnp.concatenate([none, keep]), reverse=False)
    up = carried(rows, jnp.concatenate([keep, none]), reverse=True)
    return down + (up - rows)
