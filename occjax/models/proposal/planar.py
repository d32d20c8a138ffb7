"""Planar surfaces: one plane for each large planar surface of a disparity map.

The disparity of a planar surface is a linear function of the pixel position. What remains of its
error after the selection varies slowly: view-dependent shading moves the texture of a whole region
by one or two hundredths of a pixel, at every spatial frequency. No comparison of the views within
that region can remove it. A plane that is fitted to the whole surface averages it.

Planes start at a grid of seeds and grow: they are fitted by weighted least squares to
neighbourhoods of increasing radius. The weight of a pixel falls with its deviation from the plane.
Two tests reject the tangent planes of curved surfaces. Around a tangent plane are many pixels that
deviate a little, around a planar surface almost none. And a quadratic function explains much of the
deviations from a tangent plane.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from occjax.models.proposal.config import PlanarConfig
from occjax.models.proposal.filters import box_filter


class Planes(NamedTuple):
    """Planes in a disparity map, the largest first.

    Attributes:
        coefficients: ``[n, 3]`` disparity at the first pixel, and its change along x and y over an
            eighth of the longer side of the image.
        area: ``[n]`` number of its pixels that no larger plane has; 0 for a plane that is not used.
    """

    coefficients: Float[Array, "n 3"]
    area: Float[Array, " n"]


def flatten_planar_surfaces(
    disparity: Float[Array, "h w"], information: Float[Array, "h w"], config: PlanarConfig
) -> Float[Array, "h w"]:
    """Replace the disparity of pixels on large planar surfaces by that of the plane.

    A pixel belongs to a plane if it and enough of the pixels around it deviate little from the
    plane. All other pixels keep their disparity.

    Args:
        disparity: ``[h, w]`` disparity map, in pixels per view step.
        information: ``[h, w]`` inverse variance of the disparity of each pixel, as
            :func:`occjax.models.proposal.planes.refine_disparity` estimates it.
        config: Settings.

    Returns:
        ``[h, w]`` disparity map.

    Example:
        >>> ramp = 0.01 * jnp.tile(jnp.arange(64.0), (64, 1))
        >>> wavy = ramp + 0.01 * jnp.sin(jnp.arange(64.0) / 3)[:, None]
        >>> flatten = jax.jit(flatten_planar_surfaces, static_argnames="config")
        >>> flat = flatten(wavy, jnp.full((64, 64), 1e3), config=PlanarConfig())
        >>> bool(jnp.abs(flat - ramp).max() < 0.003)
        True
    """
    deviation = expected_deviation(information, config)
    planes = find_planes(disparity, deviation, config)
    positions = _positions(disparity.shape)

    def add_plane(carried, plane):
        result, free = carried
        coefficients, area = plane
        value = jnp.tensordot(coefficients, positions, 1)
        distance = jnp.abs(disparity - value) / deviation
        near = distance < config.tolerance
        density = box_filter(near.astype(value.dtype), config.window_radius_px)
        belongs = near & free & (density > config.min_density)
        belongs &= area >= config.min_area * disparity.size
        return (jnp.where(belongs, value, result), free & ~belongs), None

    start = (disparity, jnp.ones(disparity.shape, bool))
    return jax.lax.scan(add_plane, start, planes)[0][0]


def expected_deviation(
    information: Float[Array, "h w"], config: PlanarConfig
) -> Float[Array, "h w"]:
    """Return the expected deviation of the disparity of each pixel from that of its surface.

    Args:
        information: ``[h, w]`` inverse variance of the disparity of each pixel.
        config: Settings.

    Returns:
        ``[h, w]`` deviations, in pixels per view step.

    Example:
        >>> information = jnp.full((4, 4), 1e9)
        >>> round(float(expected_deviation(information, PlanarConfig())[0, 0]), 3)
        0.01
    """
    variance = 1 / jnp.maximum(box_filter(information, 1), 1e-6)
    deviation = jnp.hypot(config.deviation, config.noise_factor * variance)
    return jnp.minimum(deviation, config.max_deviation)


def find_planes(
    disparity: Float[Array, "h w"], deviation: Float[Array, "h w"], config: PlanarConfig
) -> Planes:
    """Find the planes of the large planar surfaces of a disparity map.

    Args:
        disparity: ``[h, w]`` disparity map, in pixels per view step.
        deviation: ``[h, w]`` expected deviation of each pixel from its surface.
        config: Settings.

    Returns:
        The planes.
    """
    h, w = disparity.shape
    spacing = -(-max(h, w) // config.samples)

    def sample(maps: Array, step: int = spacing) -> Array:
        return maps[..., step // 2 :: step, step // 2 :: step]

    values, deviations, positions = (sample(x) for x in (disparity, deviation, _positions((h, w))))
    grid, unit = values.shape, max(h, w) / 8
    seeds = sample(jnp.stack([values, *positions[1:]]), min(config.seed_step, *grid))
    seeds = seeds.reshape(3, -1)
    values, deviations = values.ravel(), deviations.ravel()
    positions = positions.reshape(3, -1)
    weights = jnp.square(config.deviation / deviations)[None]

    def distance(planes: Float[Array, "k 3"]) -> Float[Array, "k n"]:
        return jnp.abs(values[None] - planes @ positions) / deviations[None]

    def fit(weights: Float[Array, "k n"]) -> Float[Array, "k 3"]:
        return _fit_planes(weights, positions[1], positions[2], values)

    seed_distance = jnp.square(positions[1:, None] - seeds[1:, :, None]).sum(0)

    def grow(planes, stage):
        radius, tolerance = stage
        close = jnp.exp(-seed_distance / (2 * jnp.square(radius)))
        robust = jnp.exp(-jnp.square(distance(planes) / tolerance) / 2)
        return fit(weights * close * robust), None

    # The first steps tolerate more, because the slope is not known yet.
    stages = [(config.radii[0], config.first_tolerance)] * (config.steps + 1)
    stages += [(radius, 1.0) for radius in config.radii for _ in range(config.steps)]
    schedule = np.array(stages) * (spacing / unit, 1.0)
    constant = jnp.zeros((seeds.shape[1], 3), values.dtype).at[:, 0].set(seeds[0])
    planes, _ = jax.lax.scan(grow, constant, jnp.asarray(schedule, values.dtype))

    def filtered(members: Float[Array, "k n"], radius: int) -> Float[Array, "k n"]:
        return box_filter(members.reshape(-1, *grid), radius).reshape(members.shape)

    near = (distance(planes) < config.tolerance).astype(values.dtype)
    members = jnp.where(filtered(near, 1) > 0.6, near, 0.0)

    def take_largest(free, _):
        area = members @ free
        largest = jnp.argmax(area)
        return free * (1 - members[largest]), (largest, area[largest])

    _, (chosen, area) = jax.lax.scan(
        take_largest, jnp.ones_like(values), None, length=config.max_planes
    )
    surface = filtered(members[chosen], 2)

    def robust_weights(planes):
        return surface * weights * jnp.exp(-jnp.square(distance(planes) / config.tolerance) / 2)

    def refit(planes, _):
        return fit(robust_weights(planes)), None

    planes, _ = jax.lax.scan(refit, planes[chosen], None, length=config.steps)
    surrounding = filtered((surface > 0.02).astype(values.dtype), 3) > 0.0
    inside, with_border = (
        (surrounding & (distance(planes) < limit)).sum(1, dtype=values.dtype)
        for limit in (config.tolerance, config.border * config.tolerance)
    )
    used = inside > config.min_isolation * with_border
    residuals = values[None] - planes @ positions
    used &= quadratic_fraction(robust_weights(planes), positions, residuals) < config.max_curvature
    return Planes(planes, jnp.where(used, area * spacing**2, 0.0))


def quadratic_fraction(
    weights: Float[Array, "k n"], positions: Float[Array, "3 n"], residuals: Float[Array, "k n"]
) -> Float[Array, " k"]:
    """Return the fraction of the variance of residuals that a quadratic function explains."""
    weights = weights / jnp.maximum(weights.sum(1, keepdims=True), 1e-9)

    def dot(one: Float[Array, "_ k n"], other: Float[Array, "_ k n"]) -> Float[Array, "_ k 1"]:
        return (weights[None] * one * other).sum(2, keepdims=True)

    x, y = positions[1:, None] - (weights @ positions[1:].T).T[..., None]
    residuals = residuals[None]
    terms = jnp.stack([jnp.ones_like(x), x, y, x * x, x * y, y * y])
    smallest = 1e-2 * jnp.sqrt(dot(terms, terms)) + 1e-8

    # Modified Gram-Schmidt: a solver of JAX would call LAPACK, which takes 0.3 s to load.
    def remove(terms: Float[Array, "6 k n"], number: Int[Array, ""]):
        term = terms[number][None]
        direction = term / jnp.maximum(jnp.sqrt(dot(term, term)), smallest[number][None])
        return terms - dot(direction, terms) * direction, jnp.square(dot(direction, residuals))

    explained = jax.lax.scan(remove, terms, jnp.arange(len(terms)))[1].sum(0)
    return (explained / jnp.maximum(dot(residuals, residuals), 1e-12)).reshape(-1)


def _positions(shape: tuple[int, ...]) -> Float[Array, "3 h w"]:
    """Return 1, x and y of each pixel, in eighths of the longer side.

    The unit keeps the moments of the positions close to 1.
    """
    unit = max(shape) / 8
    y, x = jnp.meshgrid(*(jnp.arange(size, dtype=jnp.float32) for size in shape), indexing="ij")
    return jnp.stack([jnp.ones_like(x), x / unit, y / unit])


def _fit_planes(
    weights: Float[Array, "k n"],
    x: Float[Array, " n"],
    y: Float[Array, " n"],
    values: Float[Array, " n"],
) -> Float[Array, "k 3"]:
    """Fit planes to values at positions by weighted least squares."""
    products = [jnp.ones_like(x), x, y, x * x, x * y, y * y, values, values * x, values * y]
    moments = jnp.matmul(weights, jnp.stack(products, 1), precision="highest")
    moments = moments / jnp.maximum(moments[:, :1], 1e-9)
    _, x, y, xx, xy, yy, mean, x_value, y_value = moments.T
    # The small numbers keep the slope of a plane through few pixels finite.
    xx, yy, xy = xx - x * x + 1e-5, yy - y * y + 1e-5, xy - x * y
    x_value, y_value = x_value - x * mean, y_value - y * mean
    determinant = xx * yy - xy * xy
    slope_x = (x_value * yy - y_value * xy) / determinant
    slope_y = (y_value * xx - x_value * xy) / determinant
    return jnp.stack([mean - slope_x * x - slope_y * y, slope_x, slope_y], axis=1)
