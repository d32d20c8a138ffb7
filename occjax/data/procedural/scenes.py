"""Random scenes: the surfaces and their positions.

Lengths are in pixels from the image centre; depth is ``relief`` pixels per unit of disparity.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from occjax.data.procedural import patterns
from occjax.data.procedural.appearance import Space, draw_light, draw_materials
from occjax.data.procedural.config import SceneConfig
from occjax.data.procedural.draws import Draws, Key
from occjax.data.procedural.shading import Light, Materials
from occjax.data.procedural.surfaces import Geometry, Quadrics

ABSENT_DISPARITY = -1e4
"""Disparity of absent walls, far below that of any scene."""

UNBOUNDED_HALF_EXTENT = 1e6
"""Half extent of surfaces that no box bounds."""


class RandomScene(NamedTuple):
    """A scene: everything that a light field depends on except the camera."""

    geometry: Geometry
    materials: Materials
    textures: Float[Array, "t m m"]
    light: Light


class _TangentPlanes(NamedTuple):
    """Tangent planes ``d = level + slope_x X + slope_y Y`` of the walls."""

    level: Float[Array, " n"]
    slope_x: Float[Array, " n"]
    slope_y: Float[Array, " n"]

    def disparity(self, y: Float[Array, " k"], x: Float[Array, " k"]) -> Float[Array, " k"]:
        """Return the disparity of the nearest plane, which ignores the curvature of walls."""
        level, slope_x, slope_y = (values[:, None] for values in self)
        return jnp.max(level + slope_x * x[None] + slope_y * y[None], axis=0)


def random_scene(key: Key, config: SceneConfig) -> RandomScene:
    """Draw a scene."""
    number_key, outline_key, texture_key = jax.random.split(key, 3)
    draws = Draws(number_key)
    space = _draw_space(draws, config)
    walls, planes = _draw_walls(draws, config, space)
    density = draws.uniform(0.15, 1.0)
    sheets = _draw_sheets(draws, config, space, planes, density)
    solids, group = _draw_solids(draws, config, space, planes, density)
    geometry = Geometry(
        walls=walls,
        sheets=sheets,
        outlines=patterns.outlines(draws, outline_key, config.sheets, config.outlines),
        solids=solids,
        disparity_range=jnp.stack([space.low, space.high]),
    )
    materials = draw_materials(draws, config, space, geometry, group)
    light = draw_light(draws, config, space)
    textures = patterns.textures(draws, texture_key, config.texture_count, config.textures)
    return RandomScene(geometry, materials, textures, light)


def _draw_space(draws: Draws, config: SceneConfig) -> Space:
    """Draw the range of disparity and the depth per unit of disparity."""
    lowest, highest = config.disparity_range
    width = draws.log_uniform(*config.disparity_width)
    low = draws.uniform(lowest, highest - width)
    side = min(config.image_size)
    relief = jnp.maximum(draws.log_uniform(0.12 * side, 1.0 * side), 0.35 * side / width)
    return Space(low, jnp.minimum(low + width, highest), relief)


def _draw_walls(draws: Draws, config: SceneConfig, space: Space) -> tuple[Quadrics, _TangentPlanes]:
    """Draw a plane at the lowest disparity, a wall that fills the image, and further walls."""
    count = config.walls - 1
    draws = draws.with_shape((count,))
    h, w = config.image_size
    half_side = 0.5 * max(h, w)
    width = space.high - space.low
    first = jnp.arange(count) == 0

    # The first wall stays within the range over the whole image; others cut it along a line.
    level = space.low + width * draws.uniform(0.03, 0.6)
    room = jnp.minimum(level - space.low, 0.8 * (space.high - level)) / (1.3 * half_side)
    strength = jnp.where(first, draws.unit(), draws.uniform(1.0, 4.0))
    steepest = 3.0 / space.relief
    slope = jnp.minimum(room * strength, steepest)
    slope = draws.choose(config.slanted, slope)
    turn = draws.angle()
    slope_x, slope_y = slope * jnp.cos(turn), slope * jnp.sin(turn)
    x, y = draws.uniform(-half_side, half_side), draws.uniform(-half_side, half_side)
    if count:
        # The line where another wall cuts the first passes through a random point.
        base = level[0] + slope_x[0] * x + slope_y[0] * y
        level = jnp.where(first, level, base - slope_x * x - slope_y * y)
    present = first | draws.chance(0.35)
    level = jnp.where(present, level, ABSENT_DISPARITY)

    turn = draws.angle()
    max_curvature = jnp.where(first, room / half_side, 0.3 * width / half_side**2)
    curvature_x = draws.choose(config.curved, max_curvature * draws.uniform(-1.0, 1.0))
    curvature_y = curvature_x * draws.choose(0.4, draws.uniform(-1.0, 1.0))

    def with_backdrop(values, backdrop=0.0):
        return jnp.concatenate([jnp.asarray(backdrop)[None], values])

    planes = _TangentPlanes(
        with_backdrop(level, space.low), with_backdrop(slope_x), with_backdrop(slope_y)
    )
    turn, curvature_x, curvature_y = map(with_backdrop, (turn, curvature_x, curvature_y))
    zero, one = jnp.zeros(config.walls), jnp.ones(config.walls)
    walls = Quadrics(
        matrix=_stack_rows(
            [jnp.cos(turn), jnp.sin(turn), zero],
            [-jnp.sin(turn), jnp.cos(turn), zero],
            [-planes.slope_x, -planes.slope_y, one],
        ),
        translation=jnp.stack([zero, zero, -planes.level], axis=-1),
        quadratic=jnp.stack([curvature_x, curvature_y, zero], axis=-1),
        linear=-one,
        constant=zero,
        half_extent=jnp.full((config.walls, 3), UNBOUNDED_HALF_EXTENT),
    )
    return walls, planes


def _draw_sheets(
    draws: Draws, config: SceneConfig, space: Space, planes: _TangentPlanes, density
) -> Quadrics:
    """Draw sheets: cards, leaves, fences; flat or curved."""
    count = config.sheets
    draws = draws.with_shape((count,))
    h, w = config.image_size
    side = min(h, w)
    y, x = draws.uniform(-0.55 * h, 0.55 * h), draws.uniform(-0.55 * w, 0.55 * w)
    large = draws.log_uniform(0.06 * side, 0.6 * side)
    small = large * draws.log_uniform(0.3, 1.0)
    tilt = draws.choose(0.7, draws.uniform(0.0, 1.2))
    rotation = _rotation(draws.angle(), tilt, draws.angle())

    wall = planes.disparity(y, x)
    depth = jnp.abs(rotation[:, 0, 2]) * large + jnp.abs(rotation[:, 1, 2]) * small
    room, depth, relief, floating = _fit_depth(draws, space, wall, depth)
    d = draws.choose(config.contacts, wall + depth + 0.02 * room, floating)

    curvature_x = draws.choose(config.curved, draws.uniform(-0.7, 0.7))
    curvature_y = curvature_x * draws.choose(0.3, draws.uniform(-1.0, 1.0))
    present = draws.chance(density) & (room > 0.0)
    size = jnp.stack([large, small, large], axis=-1)
    matrix, translation = _placed(rotation, size, relief, x, y, d)
    return Quadrics(
        matrix=matrix,
        # An absent sheet has no point inside its outline.
        translation=jnp.where(
            present[:, None], translation, jnp.array([0.0, 0.0, ABSENT_DISPARITY])
        ),
        quadratic=jnp.stack([curvature_x, curvature_y, jnp.zeros(count)], axis=-1),
        linear=-jnp.ones(count),
        constant=jnp.zeros(count),
        half_extent=jnp.full((count, 3), UNBOUNDED_HALF_EXTENT),
    )


def _draw_solids(
    draws: Draws, config: SceneConfig, space: Space, planes: _TangentPlanes, density
) -> tuple[Quadrics, Int[Array, " n"]]:
    """Draw boxes, ellipsoids, cylinders and rods; some form groups of overlapping solids.

    Returns the solids and, for each, the index of the solid whose material it has.
    """
    count = config.solids
    draws = draws.with_shape((count,))
    h, w = config.image_size
    side = min(h, w)
    weights = dataclasses.astuple(config.solid_kinds)
    kind = draws.category(weights)
    box, ellipsoid, rod = kind == 0, kind == 1, kind == 3
    y, x = draws.uniform(-0.5 * h, 0.5 * h), draws.uniform(-0.5 * w, 0.5 * w)
    size = draws.log_uniform(0.05 * side, 0.42 * side)
    thin = draws.log_uniform(1.2, 0.05 * side)
    aspects = jnp.stack([draws.uniform(0.35, 1.0) for _ in range(3)], axis=-1)
    half_extent = aspects * size[:, None]
    long = draws.uniform(0.25 * side, 0.9 * side)
    half_extent = jnp.where(rod[:, None], jnp.stack([thin, thin, long], axis=-1), half_extent)

    # Consecutive pairs and triples become one object with the material of the first.
    index = jnp.arange(count)
    leader = index // 3 * 3
    follows = draws.chance(config.clusters)[leader] & ~rod & (leader != index)
    spread = 0.8 * size[leader]
    x = jnp.where(follows, x[leader] + spread * draws.uniform(-1.0, 1.0), x)
    y = jnp.where(follows, y[leader] + spread * draws.uniform(-1.0, 1.0), y)

    upright = draws.chance(0.4)
    spin = draws.angle()
    rotation = jnp.where(
        upright[:, None, None],
        _rotation(spin, jnp.full(count, 0.5 * jnp.pi) + draws.uniform(-0.3, 0.3), 0.0 * spin),
        _rotation(draws.angle(), draws.uniform(0.0, jnp.pi), draws.angle()),
    )
    wall = planes.disparity(y, x)
    depth = jnp.sum(jnp.abs(rotation[:, :, 2]) * half_extent, axis=-1)
    room, depth, relief, floating = _fit_depth(draws, space, wall, depth)
    resting = wall + depth * draws.uniform(0.2, 1.0)
    d = jnp.where(draws.chance(config.contacts), resting, floating)
    d = jnp.where(follows, d[leader] + depth * draws.uniform(-0.5, 0.5), d)

    matrix, translation = _placed(rotation, jnp.ones((count, 3)), relief, x, y, d)
    present = draws.chance(density) & (room > 0.0) & (sum(weights) > 0.0)
    inverse = 1.0 / half_extent**2
    round_in = jnp.stack([~box, ~box, ellipsoid], axis=-1)
    quadrics = Quadrics(
        matrix=matrix,
        translation=translation,
        quadratic=jnp.where(round_in, inverse, 0.0),
        linear=jnp.zeros(count),
        constant=-jnp.ones(count),
        half_extent=jnp.where(present[:, None], half_extent * jnp.where(round_in, 1.01, 1.0), -1.0),
    )
    return quadrics, jnp.where(follows, leader, index)


def _rotation(
    spin: Float[Array, " n"], tilt: Float[Array, " n"], turn: Float[Array, " n"]
) -> Float[Array, "n 3 3"]:
    """Return rotations from metric to local coordinates: rows are the local axes."""
    cos_a, sin_a, cos_b, sin_b = jnp.cos(spin), jnp.sin(spin), jnp.cos(tilt), jnp.sin(tilt)
    cos_c, sin_c = jnp.cos(turn), jnp.sin(turn)
    return _stack_rows(
        [
            cos_a * cos_c - sin_a * cos_b * sin_c,
            cos_a * sin_c + sin_a * cos_b * cos_c,
            sin_a * sin_b,
        ],
        [
            -sin_a * cos_c - cos_a * cos_b * sin_c,
            -sin_a * sin_c + cos_a * cos_b * cos_c,
            cos_a * sin_b,
        ],
        [sin_b * sin_c, -sin_b * cos_c, cos_b],
    )


def _stack_rows(*rows: list[Float[Array, " n"]]) -> Float[Array, "n 3 3"]:
    """Return matrices from their entries, row by row."""
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=1)


def _fit_depth(
    draws: Draws, space: Space, wall: Float[Array, " n"], depth: Float[Array, " n"]
) -> tuple[Float[Array, " n"], ...]:
    """Fit objects between the wall and the front, and draw a disparity at which they float.

    Objects that are too deep are flattened: their relief is increased.

    Args:
        draws: Random numbers.
        space: Range of the surfaces.
        wall: Disparity of the wall behind each object.
        depth: Half the depth of each object, in pixels.

    Returns:
        Room between wall and front and half the depth, both in disparity, the relief of each
        object, and its floating disparity.
    """
    room = jnp.maximum(space.high - wall, 0.0)
    depth = depth / space.relief
    relief = space.relief * jnp.maximum(1.0, depth / (0.45 * room + 1e-3))
    depth = jnp.minimum(depth, 0.45 * room)
    return room, depth, relief, wall + depth + (room - 2.0 * depth) * draws.unit() ** 1.5


def _placed(rotation, size, relief, x, y, d):
    """Return the affine map from ``(X, Y, d)`` to the local coordinates of each object."""
    matrix = rotation / size[:, :, None]
    matrix = matrix.at[:, :, 2].multiply(relief[:, None])
    centre = jnp.stack([x, y, d], axis=-1)
    return matrix, -jnp.sum(matrix * centre[:, None, :], axis=-1)
