"""How well the views agree, by the side of the aperture they lie on: volumes for any grid.

An occluder hides a point from views on one side together. So the squared differences between the
views and the centre view are averaged in eight sectors of the aperture (by the direction of the
view's offset), and what compares the sectors can see past an occluding edge. The size of such a
volume depends neither on the number of views nor on their arrangement; a sector without views
stands for the average of the others.

Three forms, for the stages of a cascade:

* :func:`coarse_sector_costs`: whole views shifted by each disparity candidate;
* :func:`refined_sector_costs`: views warped around a disparity map, weighted by visibility;
* :func:`sector_steps`: the same cost as a parabola around the disparity map, of which every
  sector proposes the minimum: a Gauss-Newton step (Lucas, Kanade, IJCAI 1981).

All read one component of one view at a time: XLA fuses the bilinear taps of an ``[h, w]`` image
into the arithmetic around them, which arrays with a short trailing axis prevent.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, Int

from occjax.errors import InputError
from occjax.ops.filtering import box_filter, central_differences
from occjax.ops.geometry import view_offsets
from occjax.ops.matching import SECTORS
from occjax.ops.sampling import as_coordinates, as_images, base_and_fraction

HALF_APERTURE = 5
"""Neighbouring sectors that make up one half of the aperture, its edges included."""


class SectorCosts(NamedTuple):
    """Sums over the views of each sector.

    Attributes:
        sums: ``[8, d, h, w]`` weighted sum of squared differences to the centre view.
        weights: ``[8, d, h, w]``, or ``[8, 1, h, w]`` if the same for all candidates: sum of the
            weights, that is, how many views were seen.
    """

    sums: Float[Array, "8 d h w"]
    weights: Float[Array, "8 d_or_1 h w"]


class SectorSteps(NamedTuple):
    """Quadratic model ``information * step^2 - 2 * push * step + squares`` of each sector's cost.

    Attributes:
        information: ``[8, h, w]`` weighted mean over all views of the squared derivative of a view
            with respect to disparity.
        push: ``[8, h, w]`` the same of the derivative times the residual, negated;
            ``push / information`` is the step to the sector's minimum, pixels per view step.
        squares: ``[8, h, w]`` the same of the squared residual.
    """

    information: Float[Array, "8 h w"]
    push: Float[Array, "8 h w"]
    squares: Float[Array, "8 h w"]


def sector_of(offsets: Float[Array, "*grid 2"]) -> Int[Array, "*grid"]:
    """Sector of the aperture in which each view lies: its direction in steps of 45 degrees.

    Args:
        offsets: ``[..., 2]`` offset ``(row, column)`` of each view from the centre view.

    Returns:
        ``[...]`` int32; 0 is towards larger columns, 2 towards larger rows. That of the centre view
        itself is 0.

    Example:
        >>> sector_of(view_offsets(3, 3)).tolist()
        [[5, 6, 7], [4, 0, 0], [3, 2, 1]]
    """
    (offsets,) = as_coordinates(offsets)
    angle = jnp.arctan2(offsets[..., 0], offsets[..., 1])
    return jnp.round(angle * (SECTORS / (2 * np.pi))).astype(jnp.int32) % SECTORS


def coarse_sector_costs(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    *,
    truncation: Float[Array, " c"] | None = None,
    offsets: Float[Array, "v u 2"] | None = None,
) -> SectorCosts:
    """Differences of the views shifted by each candidate, summed in each sector.

    ``sums[s, d] = sum_(k in s) m_k e_k`` and ``weights[s, d] = sum m_k``, where ``m_k`` is 1 where
    the view was read inside its image, else 0. With ``difference_c = f_kc(p - d * offset_k) -
    f_0c(p)`` the cost of a view is ``e_k = sum_c difference_c^2``, or, truncated,
    ``mean_c min(|difference_c| / truncation_c, 1)``.

    Args:
        features: ``[v, u, h, w, c]`` features of the views.
        candidates: ``[d]`` disparity candidates, in pixels of the features per view step.
        truncation: ``[c]`` difference of each feature that counts as "something else"; None for
            squared differences.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        Sums and weights of ``[8, d, h, w]``. Differentiable in the features, in reverse mode.

    Raises:
        InputError: If there is no view beside the centre view, or for integer features.

    Example:
        >>> costs = coarse_sector_costs(jnp.zeros((3, 3, 8, 8, 4)), jnp.linspace(-1, 1, 5))
        >>> costs.sums.shape, float(costs.weights[:, 2, 4, 4].sum())
        ((8, 5, 8, 8), 8.0)
    """
    features = as_images(features, "v u h w c", "features")
    (candidates,) = as_coordinates(candidates)
    h, w, c = features.shape[2:]
    components = jnp.moveaxis(features, -1, 2).reshape(-1, c, h, w)
    views = _views_around(features.shape[:2], offsets)
    centre = components[views.centre]

    def cost(difference, channel):
        if truncation is None:
            return jnp.square(difference)
        return jnp.minimum(jnp.abs(difference) / truncation[channel], 1.0) / c

    @jax.checkpoint
    def add_view(costs: SectorCosts, view):
        (_, sector, offset, present), components = view
        displacements = -candidates[:, None] * offset[None]
        difference = jnp.zeros((len(candidates), h, w), features.dtype)
        for channel in range(c):
            shifted = _shifted(components[channel], displacements)
            difference = difference + cost(shifted - centre[channel][None], channel)
        seen = (present * _inside(displacements, h, w)).astype(features.dtype)
        return SectorCosts(
            costs.sums.at[sector].add(seen * difference), costs.weights.at[sector].add(seen)
        ), None

    nothing = jnp.zeros((SECTORS, len(candidates), h, w), features.dtype)
    # Views are handed to the scan, not looked up within it: their gradients are then its outputs,
    # not a sum over all views that every step would pass on.
    steps = (views.steps, components[views.steps[0]])
    return jax.lax.scan(add_view, SectorCosts(nothing, nothing), steps)[0]


def refined_sector_costs(
    views: Float[Array, "v u h w"],
    disparity: Float[Array, "h w"],
    candidates: Float[Array, " d"],
    *,
    tolerance: float,
    offsets: Float[Array, "v u 2"] | None = None,
) -> SectorCosts:
    """Squared differences of views warped around a disparity map, weighted by visibility.

    A view is seen as far as it agrees with the centre view at the candidate nearest to zero, on
    average over 3x3 pixels: ``m_k = 1 / (1 + mean r_k^2 / tolerance^2)``, and 0 where it was read
    outside its image. It is the occlusion weight of the paper (eqs. 4 to 6) with a scale.

    Args:
        views: ``[v, u, h, w]`` grey views.
        disparity: ``[h, w]`` of the centre view, pixels per view step.
        candidates: ``[d]`` residual candidates, added to the disparity of each pixel.
        tolerance: Grey difference at which a view counts half.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        Sums ``[8, d, h, w]`` and weights ``[8, 1, h, w]``.

    Raises:
        InputError: If there is no view beside the centre view, or for integer views.

    Example:
        >>> views, disparity = jnp.zeros((3, 3, 8, 8)), jnp.zeros((8, 8))
        >>> costs = refined_sector_costs(views, disparity, jnp.linspace(-1, 1, 5), tolerance=0.05)
        >>> costs.sums.shape, costs.weights.shape
        ((8, 5, 8, 8), (8, 1, 8, 8))
    """
    views = as_images(views, "v u h w")
    disparity, candidates = as_coordinates(disparity, candidates)
    h, w = views.shape[2:]
    around = _views_around(views.shape[:2], offsets)
    images = views.reshape(-1, h, w)
    centre = images[around.centre]
    middle = jnp.argmin(jnp.abs(candidates))

    def add_view(costs: SectorCosts, view):
        index, sector, offset, present = view
        image = images[index]

        def squared(candidate):
            return jnp.square(_warped(image, disparity + candidate, offset) - centre)

        visible = 1 / (1 + box_filter(squared(candidates[middle]), 1) / tolerance**2)
        visible = visible * (present * _stays_inside(disparity, offset)).astype(views.dtype)
        return SectorCosts(
            costs.sums.at[sector].add(visible[None] * jax.vmap(squared)(candidates)),
            costs.weights.at[sector].add(visible[None]),
        ), None

    start = SectorCosts(
        jnp.zeros((SECTORS, len(candidates), h, w), views.dtype),
        jnp.zeros((SECTORS, 1, h, w), views.dtype),
    )
    return jax.lax.scan(add_view, start, around.steps)[0]


def sector_steps(
    views: Float[Array, "v u h w"],
    disparity: Float[Array, "h w"],
    *,
    tolerance: float,
    offsets: Float[Array, "v u 2"] | None = None,
) -> SectorSteps:
    """Where the views of each sector say the disparity should move, and how surely.

    With the residual ``r_k = view_k(warped by d) - centre`` and its derivative
    ``g_k = -offset_k . gradient(centre)``, sector by sector and divided by the number of all views:
    ``information = sum m_k g_k^2``, ``push = -sum m_k g_k r_k``, ``squares = sum m_k r_k^2``, with
    the visibility ``m_k`` of :func:`refined_sector_costs`.

    Args:
        views: ``[v, u, h, w]`` grey views.
        disparity: ``[h, w]`` of the centre view, pixels per view step, right to a fraction of a
            pixel.
        tolerance: Grey difference at which a view counts half.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        The quadratic models of all sectors.

    Raises:
        InputError: If there is no view beside the centre view, or for integer views.

    Example:
        >>> ramp = jnp.tile(jnp.arange(8.0) / 8, (8, 1))
        >>> views = jnp.stack([ramp - 1 / 8, ramp, ramp + 1 / 8])[None]  # disparity 1
        >>> steps = sector_steps(views, jnp.full((8, 8), 0.9), tolerance=0.05)
        >>> round(float((steps.push.sum(0) / steps.information.sum(0))[4, 4]), 3)
        0.1
    """
    views = as_images(views, "v u h w")
    (disparity,) = as_coordinates(disparity)
    h, w = views.shape[2:]
    around = _views_around(views.shape[:2], offsets)
    images = views.reshape(-1, h, w)
    centre = images[around.centre]
    gradient_y, gradient_x = central_differences(centre)

    def add_view(steps: SectorSteps, view):
        index, sector, offset, present = view
        residual = _warped(images[index], disparity, offset) - centre
        visible = 1 / (1 + box_filter(jnp.square(residual), 1) / tolerance**2)
        visible = visible * (present * _stays_inside(disparity, offset)).astype(views.dtype)
        down, right = offset.astype(views.dtype)
        derivative = -(down * gradient_y + right * gradient_x)
        return SectorSteps(
            steps.information.at[sector].add(visible * jnp.square(derivative)),
            steps.push.at[sector].add(-visible * derivative * residual),
            steps.squares.at[sector].add(visible * jnp.square(residual)),
        ), None

    nothing = jnp.zeros((SECTORS, h, w), views.dtype)
    sums, _ = jax.lax.scan(add_view, SectorSteps(nothing, nothing, nothing), around.steps)
    return jax.tree.map(lambda array: array / (len(images) - 1), sums)


def sector_channels(costs: SectorCosts) -> Float[Array, "10 d h w"]:
    """Mean cost in each sector, in the whole aperture, and in the half of it that agrees best.

    Args:
        costs: Of :func:`coarse_sector_costs` or :func:`refined_sector_costs`.

    Returns:
        ``[8 + 2, d, h, w]``. A sector that sees nothing has the mean of the whole aperture.

    Example:
        >>> costs = coarse_sector_costs(jnp.ones((3, 3, 8, 8, 1)), jnp.zeros(1))
        >>> sector_channels(costs).shape
        (10, 1, 8, 8)
    """
    # Unrolled over the sectors, so that XLA computes every channel in one pass over the sums.
    sums, weights = list(costs.sums), list(costs.weights)
    every_sum, every_weight = sum(sums), sum(weights)
    little = 1e-3  # of a view, whose cost is the mean over all
    mean = every_sum / jnp.maximum(every_weight, little)
    sectors = [
        (one_sum + little * mean) / (one_weight + little)
        for one_sum, one_weight in zip(sums, weights, strict=True)
    ]

    def half(first):
        part = [(first + step) % SECTORS for step in range(HALF_APERTURE)]
        weight = sum(weights[sector] for sector in part) + little
        return (sum(sums[sector] for sector in part) + little * mean) / weight

    best = half(0)
    for first in range(1, SECTORS):
        best = jnp.minimum(best, half(first))
    return jnp.stack([*sectors, mean, best])


class _Around(NamedTuple):
    """The views one after the other, and the index of the centre view among them."""

    centre: int
    steps: tuple[Array, Array, Array, Array]  # index, sector, offset, whether it counts


def _views_around(grid: tuple[int, ...], offsets: ArrayLike | None) -> _Around:
    v, u = grid
    if v * u < 2:
        raise InputError("one view has no disparity: give a grid of at least 1x2 views")
    if offsets is None:
        offsets = view_offsets(v, u)
    (offsets,) = as_coordinates(offsets)
    if offsets.shape != (v, u, 2):
        raise InputError(f"offsets must be {[v, u, 2]}, not {list(offsets.shape)}")
    offsets = offsets.reshape(-1, 2)
    centre = (v // 2) * u + u // 2
    others = np.delete(np.arange(v * u, dtype=np.int32), centre)
    offsets = offsets[others]
    # A view at the centre's own place agrees with it at any disparity.
    counts = jnp.any(offsets != 0.0, axis=-1)
    return _Around(centre, (jnp.asarray(others), sector_of(offsets), offsets, counts))


@jax.custom_vjp
def _shifted(
    image: Float[Array, "h w"], displacements: Float[Array, "d 2"]
) -> Float[Array, "d h w"]:
    """The image read at each displacement, bilinear, zero outside.

    Its own transpose with the displacements negated, so the gradient is a gather, too; that of a
    gather would be a scatter, far slower. Displacements have no gradient.
    """

    def read(displacement):
        h, w = image.shape
        y = jnp.arange(h, dtype=displacement.dtype) + displacement[0] + 1
        x = jnp.arange(w, dtype=displacement.dtype) + displacement[1] + 1
        return _bilinear(jnp.pad(image, 1), *jnp.broadcast_arrays(y[:, None], x[None, :]))

    return jax.vmap(read)(displacements)


def _shifted_forward(image, displacements):
    return _shifted(image, displacements), displacements


def _shifted_backward(displacements, cotangents):
    def add(total, candidate):
        cotangent, displacement = candidate
        return total + _shifted(cotangent, -displacement[None])[0], None

    # One candidate after the other: each fits into the cache.
    total, _ = jax.lax.scan(add, jnp.zeros_like(cotangents[0]), (cotangents, displacements))
    return total, jnp.zeros_like(displacements)


_shifted.defvjp(_shifted_forward, _shifted_backward)


def _warped(image, disparity, offset) -> Float[Array, "h w"]:
    """A view warped to the centre view; the border is replicated."""
    return _bilinear(image, *_positions(disparity, offset))


def _positions(disparity, offset) -> tuple[Float[Array, "h w"], Float[Array, "h w"]]:
    """Where the points of the centre view lie in a view."""
    h, w = disparity.shape
    y = jnp.arange(h, dtype=disparity.dtype)[:, None] - disparity * offset[0]
    x = jnp.arange(w, dtype=disparity.dtype)[None, :] - disparity * offset[1]
    return y, x


def _stays_inside(disparity, offset) -> Array:
    """``[h, w]`` whether each point of the centre view lies inside a view."""
    h, w = disparity.shape
    y, x = _positions(disparity, offset)
    return (y >= 0) & (y <= h - 1) & (x >= 0) & (x <= w - 1)


def _inside(displacements, h: int, w: int) -> Array:
    """``[d, h, w]`` whether each pixel, displaced, lies inside the image."""
    y = jnp.arange(h, dtype=displacements.dtype)[None] + displacements[:, :1]
    x = jnp.arange(w, dtype=displacements.dtype)[None] + displacements[:, 1:]
    rows, columns = (y >= 0) & (y <= h - 1), (x >= 0) & (x <= w - 1)
    return rows[:, :, None] & columns[:, None, :]


def _bilinear(image, y, x) -> Float[Array, "h w"]:
    """An image read at positions ``[h, w]``; outside, the border is replicated."""
    row, down = base_and_fraction(y, image.shape[0])
    column, right = base_and_fraction(x, image.shape[1])
    down, right = down.astype(image.dtype), right.astype(image.dtype)

    def along(row):
        return image[row, column] * (1 - right) + image[row, column + 1] * right

    return along(row) * (1 - down) + along(row + 1) * down
