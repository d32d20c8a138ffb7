"""How well the views agree around a disparity map, by the side of the aperture they lie on.

An occluder hides a point from views on one side together. So the differences between the views and
the centre view are averaged in eight sectors of the aperture (by the direction of the view's
offset), and what compares the sectors can see past an occluding edge. The size of such a volume
depends neither on the number of views nor on their arrangement; a sector without views stands for
the average of the others.

* :func:`refined_sector_costs`: of some disparities for each pixel, how well each fits;
* :func:`sector_steps`: the cost as a parabola around a disparity map, of which every sector
  proposes the minimum: a Gauss-Newton step (Lucas, Kanade, IJCAI 1981).

The same of one disparity for the whole image is :func:`occjax.ops.matching.sector_sums`.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.ops.aperture import SECTORS, views_around
from occjax.ops.filtering import box_filter, central_differences
from occjax.ops.sampling import as_coordinates, as_images, inside_view, warp_plane

HALF_APERTURE = 5
"""Neighbouring sectors that make up one half of the aperture, its edges included."""


class SectorCosts(NamedTuple):
    """Sums over the views of each sector.

    Attributes:
        sums: ``[8, d, h, w]`` sum of what the views cost.
        weights: ``[8, d, h, w]`` their number, or what broadcasts to that: ``[8, 1, 1, 1]``.
    """

    sums: Float[Array, "8 d h w"]
    weights: Float[Array, "8 _ _ _"]


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


def refined_sector_costs(
    features: Float[Array, "v u h w c"],
    disparities: Float[Array, "d h w"],
    *,
    tolerance: Float[Array, " c"],
    offsets: Float[Array, "v u 2"] | None = None,
) -> SectorCosts:
    """Differences of the views warped by each disparity map, summed in each sector.

    With ``r_c`` the difference of a feature between the warped view and the centre view, a view
    costs ``mean_c r_c^2 / (r_c^2 + tolerance_c^2)`` (Geman, McClure, Statistical Methods for
    Tomographic Image Reconstruction, 1987): a view in which the point is hidden costs one at most.
    A view read outside its image is not counted.

    Args:
        features: ``[v, u, h, w, c]`` views or features of them.
        disparities: ``[d, h, w]`` of the centre view, pixels per view step.
        tolerance: ``[c]`` difference of each feature that costs half.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        Sums and weights of ``[8, d, h, w]``.

    Raises:
        InputError: If there is no view beside the centre view, or for integer features.

    Example:
        >>> features, maps = jnp.zeros((3, 3, 8, 8, 1)), jnp.zeros((5, 8, 8))
        >>> costs = refined_sector_costs(features, maps, tolerance=jnp.array([0.05]))
        >>> costs.sums.shape, float(costs.weights[:, 0, 4, 4].sum())
        ((8, 5, 8, 8), 8.0)
    """
    features = as_images(features, "v u h w c", "features")
    (disparities,) = as_coordinates(disparities)
    v, u, h, w, c = features.shape
    around = views_around((v, u), offsets)
    images = jnp.moveaxis(features.reshape(v * u, h, w, c), -1, 1)
    centre = images[around.centre]
    squared_tolerance = jnp.square(tolerance).astype(features.dtype)

    def add_view(costs: SectorCosts, view):
        index, sector, offset, present = view
        image = images[index]

        def one(disparity):
            seen = (present & inside_view(disparity, offset)).astype(features.dtype)
            total = jnp.zeros_like(centre[0])
            for channel in range(c):
                square = jnp.square(warp_plane(image[channel], disparity, offset) - centre[channel])
                total = total + square / (square + squared_tolerance[channel])
            return seen * total / c, seen

        cost, seen = jax.vmap(one)(disparities)
        return SectorCosts(
            costs.sums.at[sector].add(cost), costs.weights.at[sector].add(seen)
        ), None

    nothing = jnp.zeros((SECTORS, *disparities.shape), features.dtype)
    return jax.lax.scan(add_view, SectorCosts(nothing, nothing), around[1:])[0]


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
    ``information = sum m_k g_k^2``, ``push = -sum m_k g_k r_k``, ``squares = sum m_k r_k^2``.
    A view is seen as far as it agrees with the centre view, on average over 3x3 pixels:
    ``m_k = 1 / (1 + mean r_k^2 / tolerance^2)``, and 0 where it was read outside its image. That is
    the occlusion weight of the paper (eqs. 4 to 6) with a scale.

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
    around = views_around(views.shape[:2], offsets)
    images = views.reshape(-1, h, w)
    centre = images[around.centre]
    gradient_y, gradient_x = central_differences(centre)

    def add_view(steps: SectorSteps, view):
        index, sector, offset, present = view
        residual = warp_plane(images[index], disparity, offset) - centre
        visible = 1 / (1 + box_filter(jnp.square(residual), 1) / tolerance**2)
        visible = visible * (present & inside_view(disparity, offset)).astype(views.dtype)
        down, right = offset.astype(views.dtype)
        derivative = -(down * gradient_y + right * gradient_x)
        return SectorSteps(
            steps.information.at[sector].add(visible * jnp.square(derivative)),
            steps.push.at[sector].add(-visible * derivative * residual),
            steps.squares.at[sector].add(visible * jnp.square(residual)),
        ), None

    nothing = jnp.zeros((SECTORS, h, w), views.dtype)
    sums, _ = jax.lax.scan(add_view, SectorSteps(nothing, nothing, nothing), around[1:])
    return jax.tree.map(lambda array: array / (len(images) - 1), sums)


def sector_channels(costs: SectorCosts) -> Float[Array, "10 d h w"]:
    """Mean cost in each sector, in the whole aperture, and in the half of it that agrees best.

    Args:
        costs: Sums of :func:`refined_sector_costs` or :func:`occjax.ops.sector_sums`.

    Returns:
        ``[8 + 2, d, h, w]``. A sector that sees nothing has the mean of the whole aperture. The
        best half is chosen by means over 3x3 pixels: noise would choose from single ones.

    Example:
        >>> costs = SectorCosts(jnp.ones((8, 5, 6, 7)), jnp.full((8, 1, 1, 1), 2.0))
        >>> sector_channels(costs).shape
        (10, 5, 6, 7)
    """
    # Unrolled over the sectors, so that XLA computes every channel in one pass over the sums.
    sums, weights = list(costs.sums), list(costs.weights)
    little = 1e-3  # of a view, whose cost is the mean over all
    mean = sum(sums) / jnp.maximum(sum(weights), little)
    sectors = [
        (one_sum + little * mean) / (one_weight + little)
        for one_sum, one_weight in zip(sums, weights, strict=True)
    ]

    def half(first):
        part = [(first + step) % SECTORS for step in range(HALF_APERTURE)]
        weight = sum(weights[sector] for sector in part) + little
        return box_filter((sum(sums[sector] for sector in part) + little * mean) / weight, 1)

    best = half(0)
    for first in range(1, SECTORS):
        best = jnp.minimum(best, half(first))
    return jnp.stack([*sectors, mean, best])
