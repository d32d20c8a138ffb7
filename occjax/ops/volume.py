"""Cost volumes: views are registered with the centre view for each candidate, then combined.

Three independent choices define a volume:

* the sampling: :func:`coarse_volume` shifts whole views, :func:`refined_volume` warps them around a
  disparity map;
* ``combine``, the function that turns the registered views at one candidate into a plane of the
  volume: :func:`concatenate` (the published network), :func:`mean_and_variance`,
  :func:`group_correlation`, or any function of the same signature, for instance a matching cost;
* ``streamed``: compute all candidates at once, or one after the other, which keeps the registered
  views of only one candidate in memory. Both give the same volume.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from occjax.errors import InputError
from occjax.kernels.bilinear import whole_and_fraction
from occjax.kernels.reductions import accumulation_dtype
from occjax.lightfield import centre_index
from occjax.ops.sampling import (
    Border,
    Rows,
    as_coordinates,
    as_images,
    as_offsets,
    as_rows,
    shift,
    warp,
)

Combine = Callable[[Float[Array, "v u h w c"], Float[Array, "v u h w"] | None], Float[Array, "..."]]
"""Function of the registered views and their weights at one candidate; returns a volume plane."""


def concatenate(
    views: Float[Array, "v u h w c"], weights: Float[Array, "v u h w"] | None = None
) -> Float[Array, "h w v*u*c"]:
    """Concatenate the features of all views: the "concat" of shift-and-concat (eq. 2).

    Args:
        views: ``[v, u, h, w, c]`` views registered with the centre view.
        weights: ``[v, u, h, w]`` factor of each view at each pixel; None for 1.

    Returns:
        ``[h, w, v * u * c]``; the channel of view (v, u) and feature c is ``(v * U + u) * C + c``.

    Raises:
        InputError: If the views are not floating point or the weights do not fit them.

    Example:
        >>> concatenate(jnp.zeros((3, 3, 4, 5, 2))).shape
        (4, 5, 18)
    """
    views, weights = _views_and_weights(views, weights)
    if weights is not None:
        views = views * weights[..., None].astype(views.dtype)
    v, u, h, w, c = views.shape
    return views.transpose(2, 3, 0, 1, 4).reshape(h, w, v * u * c)


def mean_and_variance(
    views: Float[Array, "v u h w c"], weights: Float[Array, "v u h w"] | None = None
) -> Float[Array, "h w 2*c"]:
    """Compute the weighted mean and variance over the views.

    ``mean = sum(w f) / sum(w)``, ``variance = sum(w (f - mean)^2) / sum(w)``. The number of
    channels does not depend on the number of views (the paper names this as future work), and
    occluded views of low weight do not raise the variance. Where all weights are zero, mean,
    variance and all gradients are zero.

    Args:
        views: ``[v, u, h, w, c]`` views registered with the centre view.
        weights: ``[v, u, h, w]`` non-negative weight of each view at each pixel; None for equal
            weights.

    Returns:
        ``[h, w, 2 * c]``: first the c means, then the c variances.

    Raises:
        InputError: If the views are not floating point or the weights do not fit them.

    Example:
        >>> mean_and_variance(jnp.arange(4.0).reshape(2, 2, 1, 1, 1)).tolist()
        [[[1.5, 1.25]]]
    """
    views, weights = _views_and_weights(views, weights)
    if weights is None:
        mean = views.mean((0, 1))
        variance = jnp.square(views - mean[None, None]).mean((0, 1))
    else:
        shares = _normalise(weights)[..., None].astype(views.dtype)
        mean = (shares * views).sum((0, 1))
        variance = (shares * jnp.square(views - mean[None, None])).sum((0, 1))
    return jnp.concatenate([mean, variance], axis=-1)


def group_correlation(groups: int) -> Combine:
    """Return a ``combine`` function: group-wise correlation of the views with the centre view.

    The c channels are split into groups. The correlation of a group is
    ``mean_c(f_view * f_centre)`` (Guo et al., Group-wise Correlation Stereo Network, CVPR 2019,
    eq. 2). The plane holds its weighted mean over the views; it is zero, with zero gradients, where
    all weights are zero.

    Args:
        groups: Number of groups, at least 1; must divide the number of channels.

    Returns:
        A ``combine`` function whose planes are ``[h, w, groups]``.

    Raises:
        InputError: If ``groups`` is less than 1. The returned function raises it if ``groups`` does
            not divide the number of channels.

    Example:
        >>> group_correlation(2)(jnp.ones((3, 3, 4, 5, 6)), None).shape
        (4, 5, 2)
    """
    if groups < 1:
        raise InputError(f"groups must be at least 1, not {groups}")

    def combine(
        views: Float[Array, "v u h w c"], weights: Float[Array, "v u h w"] | None = None
    ) -> Float[Array, "h w groups"]:
        views, weights = _views_and_weights(views, weights)
        v, u, h, w, c = views.shape
        if c % groups:
            raise InputError(f"groups must divide the {c} channels; {groups} does not")
        centre = views[centre_index((v, u))]
        products = (views * centre[None, None]).reshape(v, u, h, w, groups, c // groups).mean(-1)
        if weights is None:
            return products.mean((0, 1))
        return (_normalise(weights)[..., None].astype(views.dtype) * products).sum((0, 1))

    return combine


def coarse_volume(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    *,
    weights: Float[Array, "v u r w"] | None = None,
    offsets: Float[Array | np.ndarray, "v u 2"] | None = None,
    combine: Combine = concatenate,
    streamed: bool = False,
    rows: Rows | None = None,
) -> Float[Array, "d ..."]:
    """Compute the cost volume of whole-image sub-pixel shifts (eq. 2, shift-and-concat).

    Taps outside a view read zero. The derivatives are those of :func:`occjax.ops.shift` and of
    ``combine``.

    Args:
        features: ``[v, u, h, w, c]`` features or images of the views.
        candidates: ``[d]`` disparity candidates, pixels per view step.
        weights: ``[v, u, r, w]`` weight of each view at each pixel of the centre view.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in view
            steps; a regular grid by default.
        combine: Function that combines the registered views at one candidate.
        streamed: Compute one candidate, or one row of views, after the other. Needs less memory.
        rows: First row and number of rows r of the centre view to compute, to process a large image
            strip by strip; all rows by default.

    Returns:
        ``[d, r, w, k]``, or ``[d, ...]`` with the planes that ``combine`` returns.

    Raises:
        InputError: If the features are not floating point, or the shapes do not fit together.

    Example:
        >>> features = jnp.zeros((3, 3, 8, 8, 4))
        >>> coarse_volume(features, jnp.linspace(-1, 1, 5)).shape
        (5, 8, 8, 36)
    """
    features = as_images(features, "v u h w c", "features")
    candidates, offsets = _candidates(candidates), as_offsets(offsets, features.shape[:2])
    v, u, h, w, _ = features.shape
    strip = as_rows(rows, h)
    weights = _weights(weights, (v, u, strip[1], w))
    if streamed and combine is concatenate and weights is None:
        return _concatenated_volume(features, candidates, offsets, strip)

    def register(candidate):
        def shift_view(view, offset):
            return shift(view, candidate, offset, rows=strip)

        return jax.vmap(jax.vmap(shift_view))(features, offsets)

    return _combined(register, candidates, combine, weights, streamed)


def _concatenated_volume(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    offsets: Float[Array, "v u 2"],
    rows: Rows,
) -> Float[Array, "d r w k"]:
    """Compute the coarse volume of :func:`concatenate`, one row of views after the other.

    Planes that are contiguous in x are shifted first and transposed afterwards. On a CPU this is
    several times faster than a shift of interleaved channels. The loop over rows of views keeps XLA
    from fusing the two steps.
    """
    first, count = rows
    v, u, h, w, c = features.shape

    def add_row_of_views(volume, row):
        views, offsets, number = row
        # whole_and_fraction limits a shift to h + 2 pixels; the frame is one pixel larger.
        frame = ((0, 0), (0, 0), (h + 3, h + 3), (w + 3, w + 3))
        framed = jnp.pad(views.transpose(0, 3, 1, 2), frame)

        def shift_view(view, displacement):
            whole, fraction = whole_and_fraction(displacement, (h, w), view.dtype)
            row, column = whole + jnp.array([h + 3, w + 3], jnp.int32)
            row = row + jnp.asarray(first, jnp.int32)

            def tap(down, right):
                start = (0, row + down, column + right)
                return jax.lax.dynamic_slice(view, start, (c, count, w))

            one = jnp.ones((), view.dtype)
            left, right = (
                tap(0, side) * (one - fraction[0]) + tap(1, side) * fraction[0] for side in (0, 1)
            )
            return left * (one - fraction[1]) + right * fraction[1]

        def shift_row(candidate):
            return jax.vmap(shift_view)(framed, -candidate * offsets)

        planes = jax.lax.map(shift_row, candidates)
        planes = planes.transpose(0, 3, 4, 1, 2).reshape(len(candidates), count, w, 1, u * c)
        return jax.lax.dynamic_update_slice_in_dim(volume, planes, number, 3), None

    volume = jnp.zeros((len(candidates), count, w, v, u * c), features.dtype)
    volume, _ = jax.lax.scan(add_row_of_views, volume, (features, offsets, jnp.arange(v)))
    return volume.reshape(len(candidates), count, w, v * u * c)


def coarse_volume_means(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    *,
    offsets: Float[Array | np.ndarray, "v u 2"] | None = None,
) -> Float[Array, " k"]:
    """Compute the mean of each channel of :func:`coarse_volume`, in closed form.

    The mean is over candidates and pixels and is the input of the published network's view
    attention. The weight of a row or column of a view depends on the candidate alone, so the volume
    itself is not computed. The derivatives are those of the mean of the volume.

    Args:
        features: ``[v, u, h, w, c]`` features or images of the views.
        candidates: ``[d]`` disparity candidates, pixels per view step.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in view
            steps; a regular grid by default.

    Returns:
        ``[v * u * c]`` means in the channel order of :func:`concatenate`, at least float32.

    Raises:
        InputError: If the features are not floating point, or the shapes do not fit together.

    Example:
        >>> coarse_volume_means(jnp.ones((3, 3, 8, 8, 4)), jnp.zeros(5))[:3].tolist()
        [1.0, 1.0, 1.0]
    """
    features = as_images(features, "v u h w c", "features")
    candidates, offsets = _candidates(candidates), as_offsets(offsets, features.shape[:2])
    _, _, h, w, _ = features.shape
    features = features.astype(accumulation_dtype(features))

    def mean_weights(size, offset):
        """Return ``[v, u, d, size]``: the weight of each row or column in the mean of a shift."""
        displacement = candidates[None, None, :, None] * offset[:, :, None, None]
        target = jnp.arange(size, dtype=displacement.dtype)[None, None, None] + displacement
        lower = jnp.floor(target)
        inside = [(tap >= 0) & (tap < size) for tap in (lower, lower + 1)]
        weights = (1 - (target - lower), target - lower)
        terms = zip(inside, weights, strict=True)
        total = sum(jnp.where(valid, weight, 0) for valid, weight in terms)
        return (total / size).astype(features.dtype)

    rows, columns = mean_weights(h, offsets[..., 0]), mean_weights(w, offsets[..., 1])
    row_means = jnp.einsum("vudi,vuijc->vudjc", rows, features, precision="highest")
    means = jnp.einsum("vudj,vudjc->vuc", columns, row_means, precision="highest")
    return means.reshape(-1) / len(candidates)


def refined_volume(
    features: Float[Array, "v u h w c"],
    disparity: Float[Array, "r w"],
    candidates: Float[Array, " d"],
    *,
    weights: Float[Array, "v u r w"] | None = None,
    offsets: Float[Array | np.ndarray, "v u 2"] | None = None,
    combine: Combine = concatenate,
    border: Border = "replicate",
    streamed: bool = False,
    first_row: int | Int[Array, ""] = 0,
) -> Float[Array, "d ..."]:
    """Compute the cost volume of per-pixel warps around a disparity map (eqs. 3 and 8).

    The derivatives are those of :func:`occjax.ops.warp` and of ``combine``.

    Args:
        features: ``[v, u, h, w, c]`` features or images of the views.
        disparity: ``[r, w]`` of all or some rows of the centre view, pixels per view step.
        candidates: ``[d]`` residual candidates, added to the disparity of each pixel.
        weights: ``[v, u, r, w]`` weight of each view at each pixel of the centre view, for instance
            from :func:`occjax.ops.occlusion_weights` (eq. 6).
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in view
            steps; a regular grid by default.
        combine: Function that combines the registered views at one candidate.
        border: Values outside a view, see :func:`occjax.ops.warp`.
        streamed: Compute one candidate after the other. Needs less memory.
        first_row: Row of the centre view at which ``disparity`` begins.

    Returns:
        ``[d, r, w, k]``, or ``[d, ...]`` with the planes that ``combine`` returns.

    Raises:
        InputError: If the features are not floating point, or the shapes do not fit together.

    Example:
        >>> features, disparity = jnp.zeros((3, 3, 8, 8, 4)), jnp.zeros((8, 8))
        >>> refined_volume(features, disparity, jnp.linspace(-0.5, 0.5, 3)).shape
        (3, 8, 8, 36)
    """
    features = as_images(features, "v u h w c", "features")
    candidates = _candidates(candidates)
    weights = _weights(weights, (*features.shape[:2], *jnp.shape(disparity)))

    def register(candidate):
        start, residual = as_coordinates(disparity, candidate)
        return warp_views(
            features, start + residual, offsets=offsets, border=border, first_row=first_row
        )

    return _combined(register, candidates, combine, weights, streamed)


def warp_views(
    views: Float[Array, "v u h w c"],
    disparity: Float[Array, "r w"],
    *,
    offsets: Float[Array | np.ndarray, "v u 2"] | None = None,
    border: Border = "replicate",
    first_row: int | Int[Array, ""] = 0,
) -> Float[Array, "v u r w c"]:
    """Warp every view to the centre view by the centre view's disparity (eq. 4).

    Args:
        views: ``[v, u, h, w, c]`` views or their features.
        disparity: ``[r, w]`` of all or some rows of the centre view, pixels per view step.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in view
            steps; a regular grid by default.
        border: Values outside a view, see :func:`occjax.ops.warp`.
        first_row: Row of the centre view at which ``disparity`` begins.

    Returns:
        ``[v, u, r, w, c]`` warped views. With the true disparity they agree, except at occlusions.

    Raises:
        InputError: If the views are not floating point, or the shapes do not fit together.

    Example:
        >>> warp_views(jnp.ones((3, 3, 4, 4, 1)), jnp.zeros((4, 4))).shape
        (3, 3, 4, 4, 1)
    """
    views = as_images(views, "v u h w c")

    def register(view, offset):
        return warp(view, disparity, offset, border=border, first_row=first_row)

    return jax.vmap(jax.vmap(register))(views, as_offsets(offsets, views.shape[:2]))


def _combined(
    register: Callable[[Array], Array],
    candidates: Float[Array, " d"],
    combine: Combine,
    weights: Array | None,
    streamed: bool,
) -> Float[Array, "d ..."]:
    """Return the planes that ``combine`` makes of the views registered at each candidate."""
    if not callable(combine):
        raise InputError(f"combine must be a function such as ops.concatenate, not {combine!r}")

    def plane(candidate):
        return combine(register(candidate), weights)

    return jax.lax.map(plane, candidates) if streamed else jax.vmap(plane)(candidates)


def _candidates(candidates: ArrayLike) -> Float[Array, " d"]:
    (candidates,) = as_coordinates(candidates)
    if candidates.ndim != 1 or not candidates.size:
        raise InputError(
            f"candidates must be a vector [d], d at least 1, not {list(candidates.shape)}"
        )
    return candidates


def _weights(weights: ArrayLike | None, shape: tuple[int, ...]) -> Array | None:
    """Return the weights after a check of their shape; weights are not broadcast."""
    if weights is None:
        return None
    weights = jnp.asarray(weights)
    if weights.shape != shape:
        raise InputError(f"weights must be {list(shape)}, not {list(weights.shape)}")
    return weights


def _views_and_weights(
    views: ArrayLike, weights: ArrayLike | None
) -> tuple[Float[Array, "v u h w c"], Array | None]:
    views = as_images(views, "v u h w c")
    return views, _weights(weights, views.shape[:4])


def _normalise(weights: Float[Array, "v u h w"]) -> Float[Array, "v u h w"]:
    """Return weights that sum to one over the views, or to zero where all are zero."""
    total = weights.sum((0, 1), keepdims=True)
    present = total > 0
    return jnp.where(present, weights / jnp.where(present, total, jnp.ones_like(total)), 0.0)
