"""Cost volumes: the views brought into register for each disparity candidate, then combined.

A volume is a choice of three independent things:

* the sampling: :func:`coarse_volume` shifts whole views, :func:`refined_volume` warps them around a
  disparity map;
* ``combine``, what becomes of the registered views at one candidate: :func:`concatenate` (the
  published network), :func:`mean_and_variance` or :func:`group_correlation`, or any function of the
  same signature, for instance one that reduces a plane to a cost;
* ``streamed``: all candidates at once, or one after the other, which keeps only one candidate's
  registered views in memory. The answer is the same.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from occjax.errors import InputError
from occjax.ops.convolution import type_of_sums
from occjax.ops.geometry import view_offsets
from occjax.ops.sampling import (
    Border,
    Rows,
    as_coordinates,
    as_images,
    shift,
    warp,
    whole_and_fraction,
)

Combine = Callable[[Float[Array, "v u h w c"], Float[Array, "v u h w"] | None], Float[Array, "..."]]
"""Registered views and their weights at one candidate -> that candidate's plane of the volume."""


def concatenate(
    views: Float[Array, "v u h w c"], weights: Float[Array, "v u h w"] | None = None
) -> Float[Array, "h w v*u*c"]:
    """All features of all views side by side, the "concat" of shift-and-concat.

    Args:
        views: ``[v, u, h, w, c]`` views in register with the centre view.
        weights: ``[v, u, h, w]`` factor of each view at each pixel, or None for one.

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
    """Weighted mean and variance over the views: a volume whose depth is free of their number.

    ``mean = sum(w f) / sum(w)``, ``variance = sum(w (f - mean)^2) / sum(w)``. The paper names it as
    future work; with occlusion weights, occluded views do not raise the variance.

    Args:
        views: ``[v, u, h, w, c]`` views in register with the centre view.
        weights: ``[v, u, h, w]`` non-negative weight of each view at each pixel, or None for equal.
            Where all are zero, mean and variance are zero.

    Returns:
        ``[h, w, 2 * c]``: the c means, then the c variances.

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
        normalised = _normalised(weights)[..., None].astype(views.dtype)
        mean = (normalised * views).sum((0, 1))
        variance = (normalised * jnp.square(views - mean[None, None])).sum((0, 1))
    return jnp.concatenate([mean, variance], axis=-1)


def group_correlation(groups: int) -> Combine:
    """Group-wise correlation of each view with the centre view, averaged over the views.

    The c channels are split into groups; in each, ``mean_c(f_view * f_centre)`` (Guo et al.,
    Group-wise Correlation Stereo Network, CVPR 2019, eq. 2), then the weighted mean over the views.

    Args:
        groups: Number of groups, at least 1; must divide the number of channels.

    Returns:
        A ``combine`` function whose planes are ``[h, w, groups]``.

    Raises:
        InputError: If there is no group; when called, if the groups do not divide the channels.

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
            raise InputError(f"groups must divide the channels: {c} are no multiple of {groups}")
        centre = views[v // 2, u // 2]
        products = (views * centre[None, None]).reshape(v, u, h, w, groups, c // groups).mean(-1)
        if weights is None:
            return products.mean((0, 1))
        return (_normalised(weights)[..., None].astype(views.dtype) * products).sum((0, 1))

    return combine


def coarse_volume(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    *,
    weights: Float[Array, "v u r w"] | None = None,
    offsets: Float[Array, "v u 2"] | None = None,
    combine: Combine = concatenate,
    streamed: bool = False,
    rows: Rows | None = None,
) -> Float[Array, "d ..."]:
    """Cost volume of whole-image sub-pixel shifts (eq. 2, shift-and-concat).

    Args:
        features: ``[v, u, h, w, c]`` features (or the images) of the views.
        candidates: ``[d]`` disparity candidates, pixels per view step.
        weights: ``[v, u, r, w]`` weight of each view at each pixel of the centre view.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.
        combine: What becomes of the registered views at one candidate.
        streamed: One candidate, or one row of views, after the other (little memory) instead of
            all at once.
        rows: First row and number of rows r of the centre view to compute; all by default. An image
            too large for memory is done strip by strip.

    Returns:
        ``[d, r, w, k]``, or ``[d, ...]`` with whatever planes ``combine`` makes. Taps outside a
        view read zero.

    Raises:
        InputError: If the features are not floating point, or the shapes do not fit together.

    Example:
        >>> features = jnp.zeros((3, 3, 8, 8, 4))
        >>> coarse_volume(features, jnp.linspace(-1, 1, 5)).shape
        (5, 8, 8, 36)
    """
    features = as_images(features, "v u h w c", "features")
    candidates, offsets = _candidates(candidates), _offsets(features, offsets)
    v, u, h, w, _ = features.shape
    weights = _weights(weights, (v, u, h if rows is None else rows[1], w))
    if streamed and combine is concatenate and weights is None:
        return _concatenated(features, candidates, offsets, (0, h) if rows is None else rows)

    def plane(candidate):
        def to_centre(view, offset):
            return shift(view, candidate, offset, rows=rows)

        return combine(jax.vmap(jax.vmap(to_centre))(features, offsets), weights)

    return _over_candidates(plane, candidates, streamed)


def _concatenated(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    offsets: Float[Array, "v u 2"],
    rows: Rows,
) -> Float[Array, "d r w k"]:
    """The coarse volume of :func:`concatenate`, one row of views after the other.

    On a CPU several times faster than shifting while channels are put side by side: planes are
    shifted, contiguous in x, then transposed. Only a loop's end keeps XLA from fusing the two.
    """
    first, count = rows
    v, u, h, w, c = features.shape

    def add_row_of_views(volume, row):
        views, offsets, number = row
        # A shift that goes beyond the frame would read nothing but zeros.
        frame = ((0, 0), (0, 0), (h + 3, h + 3), (w + 3, w + 3))
        framed = jnp.pad(views.transpose(0, 3, 1, 2), frame)

        def shifted(view, displacement):
            whole, fraction = whole_and_fraction(displacement, (h, w), view.dtype)
            row, column = whole + jnp.array([h + 3, w + 3], jnp.int32)
            row = row + jnp.asarray(first, jnp.int32)

            def tap(down, right):
                start = (0, row + down, column + right)
                return jax.lax.dynamic_slice(view, start, (c, count, w))

            one = jnp.ones((), view.dtype)
            left, right = (
                tap(0, at) * (one - fraction[0]) + tap(1, at) * fraction[0] for at in (0, 1)
            )
            return left * (one - fraction[1]) + right * fraction[1]

        def at(candidate):
            return jax.vmap(shifted)(framed, -candidate * offsets)

        planes = jax.lax.map(at, candidates)
        planes = planes.transpose(0, 3, 4, 1, 2).reshape(len(candidates), count, w, 1, u * c)
        return jax.lax.dynamic_update_slice_in_dim(volume, planes, number, 3), None

    volume = jnp.zeros((len(candidates), count, w, v, u * c), features.dtype)
    volume, _ = jax.lax.scan(add_row_of_views, volume, (features, offsets, jnp.arange(v)))
    return volume.reshape(len(candidates), count, w, v * u * c)


def coarse_volume_means(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    *,
    offsets: Float[Array, "v u 2"] | None = None,
) -> Float[Array, " k"]:
    """Mean of each channel of :func:`coarse_volume` over candidates and pixels, in closed form.

    How much each row and each column of a view counts depends on the candidate alone, so no volume
    is needed for what the view attention of the published network looks at.

    Args:
        features: ``[v, u, h, w, c]`` features (or the images) of the views.
        candidates: ``[d]`` disparity candidates, pixels per view step.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        ``[v * u * c]``, channels as :func:`concatenate` has them; in at least float32.

    Raises:
        InputError: If the features are not floating point, or the shapes do not fit together.

    Example:
        >>> coarse_volume_means(jnp.ones((3, 3, 8, 8, 4)), jnp.zeros(5))[:3].tolist()
        [1.0, 1.0, 1.0]
    """
    features = as_images(features, "v u h w c", "features")
    candidates, offsets = _candidates(candidates), _offsets(features, offsets)
    _, _, h, w, _ = features.shape
    features = features.astype(type_of_sums(features))

    def counts(size, offset):
        """``[v, u, d, size]``: which share of a pixel's value comes from each row or column."""
        moved = candidates[None, None, :, None] * offset[:, :, None, None]
        place = jnp.arange(size, dtype=moved.dtype)[None, None, None] + moved
        lower = jnp.floor(place)
        inside = [(at >= 0) & (at < size) for at in (lower, lower + 1)]
        shares = (1 - (place - lower), place - lower)
        total = sum(jnp.where(*each, 0) for each in zip(inside, shares, strict=True))
        return (total / size).astype(features.dtype)

    rows, columns = counts(h, offsets[..., 0]), counts(w, offsets[..., 1])
    of_rows = jnp.einsum("vudi,vuijc->vudjc", rows, features, precision="highest")
    means = jnp.einsum("vudj,vudjc->vuc", columns, of_rows, precision="highest")
    return means.reshape(-1) / len(candidates)


def refined_volume(
    features: Float[Array, "v u h w c"],
    disparity: Float[Array, "r w"],
    candidates: Float[Array, " d"],
    *,
    weights: Float[Array, "v u r w"] | None = None,
    offsets: Float[Array, "v u 2"] | None = None,
    combine: Combine = concatenate,
    border: Border = "replicate",
    streamed: bool = False,
    first_row: int | Int[Array, ""] = 0,
) -> Float[Array, "d ..."]:
    """Cost volume of per-pixel warps around a disparity map (eqs. 3 and 8).

    Args:
        features: ``[v, u, h, w, c]`` features (or the images) of the views.
        disparity: ``[r, w]`` of all or some rows of the centre view, pixels per view step.
        candidates: ``[d]`` residual candidates, added to the disparity of each pixel.
        weights: ``[v, u, r, w]`` weight of each view at each pixel of the centre view, for instance
            :func:`occjax.ops.occlusion_weights` (eq. 6).
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.
        combine: What becomes of the registered views at one candidate.
        border: What lies outside a view, see :func:`occjax.ops.warp`.
        streamed: One candidate after the other (little memory) instead of all at once.
        first_row: Row of the centre view at which ``disparity`` begins.

    Returns:
        ``[d, r, w, k]``, or ``[d, ...]`` with whatever planes ``combine`` makes.

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

    def plane(candidate):
        start, residual = as_coordinates(disparity, candidate)
        registered = warp_views(
            features, start + residual, offsets=offsets, border=border, first_row=first_row
        )
        return combine(registered, weights)

    return _over_candidates(plane, candidates, streamed)


def warp_views(
    views: Float[Array, "v u h w c"],
    disparity: Float[Array, "r w"],
    *,
    offsets: Float[Array, "v u 2"] | None = None,
    border: Border = "replicate",
    first_row: int | Int[Array, ""] = 0,
) -> Float[Array, "v u r w c"]:
    """Warp every view to the centre view by the centre view's disparity (eq. 4).

    Args:
        views: ``[v, u, h, w, c]`` views or their features.
        disparity: ``[r, w]`` of all or some rows of the centre view, pixels per view step.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.
        border: What lies outside a view, see :func:`occjax.ops.warp`.
        first_row: Row of the centre view at which ``disparity`` begins.

    Returns:
        ``[v, u, r, w, c]`` warped views; with the true disparity, all alike but for occlusions.

    Raises:
        InputError: If the views are not floating point, or the shapes do not fit together.

    Example:
        >>> warp_views(jnp.ones((3, 3, 4, 4, 1)), jnp.zeros((4, 4))).shape
        (3, 3, 4, 4, 1)
    """
    views = as_images(views, "v u h w c")

    def to_centre(view, offset):
        return warp(view, disparity, offset, border=border, first_row=first_row)

    return jax.vmap(jax.vmap(to_centre))(views, _offsets(views, offsets))


def _over_candidates(
    plane: Callable[[Array], Array], candidates: Float[Array, " d"], streamed: bool
) -> Float[Array, "d ..."]:
    return jax.lax.map(plane, candidates) if streamed else jax.vmap(plane)(candidates)


def _candidates(candidates: ArrayLike) -> Float[Array, " d"]:
    (candidates,) = as_coordinates(candidates)
    if candidates.ndim != 1:
        raise InputError(f"candidates must be a list [d], not {list(candidates.shape)}")
    return candidates


def _offsets(views: Array, offsets: ArrayLike | None) -> Float[Array, "v u 2"]:
    grid = views.shape[:2]
    if offsets is None:
        return view_offsets(*grid)
    (offsets,) = as_coordinates(offsets)
    if offsets.shape != (*grid, 2):
        raise InputError(f"offsets must be {[*grid, 2]}, not {list(offsets.shape)}")
    return offsets


def _weights(weights: ArrayLike | None, shape: tuple[int, ...]) -> Array | None:
    """Weights of exactly the shape: one for all views or all pixels would pass by broadcasting."""
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


def _normalised(weights: Float[Array, "v u h w"]) -> Float[Array, "v u h w"]:
    """Weights that sum to one over the views, or to zero where there is none."""
    total = weights.sum((0, 1), keepdims=True)
    present = total > 0
    return jnp.where(present, weights / jnp.where(present, total, jnp.ones_like(total)), 0.0)
