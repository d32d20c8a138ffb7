"""Appearance of random scenes: the materials of their surfaces, and the light."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from occjax.data.procedural.config import SceneConfig
from occjax.data.procedural.draws import Draws
from occjax.data.procedural.shading import Light, Materials
from occjax.data.procedural.surfaces import Geometry


class Space(NamedTuple):
    """Range of the surfaces of a scene.

    Attributes:
        low: Lowest disparity.
        high: Highest disparity.
        relief: Depth per unit of disparity, in pixels.
    """

    low: Float[Array, ""]
    high: Float[Array, ""]
    relief: Float[Array, ""]


def draw_materials(
    draws: Draws, config: SceneConfig, space: Space, geometry: Geometry, group: Int[Array, " n"]
) -> Materials:
    """Draw the materials of all walls, sheets and solids.

    ``group`` has the index of the solid whose material each solid has.
    """
    surfaces = geometry.surfaces
    count = len(surfaces.linear)
    scene, draws = draws, draws.with_shape((count,))
    texture_count = config.texture_count

    def index():
        return jnp.minimum((draws.unit() * texture_count).astype(jnp.int32), texture_count - 1)

    texture, detail = index(), index()
    calm = jnp.where(scene.chance(config.calm), 0.08, 1.0)
    contrast = draws.choose(
        config.low_contrast, draws.log_uniform(0.008, 0.06), draws.uniform(0.1, 0.9)
    )
    contrast = draws.choose(config.textureless, 0.0, calm * contrast)
    detail_strength = draws.choose(0.5, 0.0, draws.log_uniform(0.03, 0.6))
    detail_contrast = jnp.where(contrast > 0.0, jnp.minimum(detail_strength, contrast), 0.0)
    tone = draws.uniform(0.04, 0.9)
    like_wall = draws.chance(config.similar)
    # Solids of a group look like the first one. Some surfaces look like wall 1, which fills the
    # image, or like wall 0 if that is the only one.
    first_solid = count - config.solids
    leader = jnp.concatenate([jnp.arange(first_solid), first_solid + group])
    appearance = jnp.where(like_wall[leader], min(1, config.walls - 1), leader)
    tone_factor = 1.0 + draws.choose(0.6, draws.uniform(-0.12, 0.12))

    # The texel axes are two directions at right angles to the local z axis of the surface.
    normal = surfaces.matrix[:, 2].at[:, 2].divide(space.relief)
    normal = normal / jnp.linalg.norm(normal, axis=-1, keepdims=True)
    tilted = (
        normal
        + jnp.stack([draws.uniform(-0.5, 0.5) for _ in range(3)], axis=-1)
        * (jnp.arange(count) >= first_solid).astype(jnp.float32)[:, None]
    )
    normal = tilted / jnp.linalg.norm(tilted, axis=-1, keepdims=True)
    turn = draws.angle()
    helper = jnp.stack([jnp.cos(turn), jnp.sin(turn), 0.3 * jnp.sin(3.0 * turn)], axis=-1)
    first = jnp.cross(normal, helper)
    first = first / (jnp.linalg.norm(first, axis=-1, keepdims=True) + 1e-6)
    second = jnp.cross(normal, first)
    texels = draws.log_uniform(0.4, 1.5)[appearance]
    texel_map = jnp.stack([first, second], axis=1) * texels[:, None, None]
    texel_map = texel_map.at[:, :, 2].multiply(space.relief)
    texel_origin = jnp.stack([draws.uniform(0.0, 256.0), draws.uniform(0.0, 256.0)], axis=-1)

    glossy = scene.chance(config.highlights)
    gloss = draws.choose(0.6, draws.uniform(0.1, 0.7)) * jnp.where(glossy, 1.0, 0.0)
    mirrors = scene.chance(config.reflections)
    mirror = draws.choose(0.4, draws.uniform(0.02, 0.15)) * jnp.where(mirrors, 1.0, 0.0)
    return Materials(
        texel_map=texel_map,
        texel_origin=texel_origin,
        texture=texture[appearance],
        detail=detail[appearance],
        detail_scale=draws.log_uniform(0.2, 1.0),
        tone=tone[appearance] * tone_factor,
        contrast=contrast[appearance],
        detail_contrast=detail_contrast[appearance],
        gloss=gloss[leader],
        sharpness=draws.log_uniform(6.0, 250.0)[leader],
        mirror=mirror[leader],
    )


def draw_light(draws: Draws, config: SceneConfig, space: Space) -> Light:
    """Draw the lamp, the ambient light, shadows and the direction to the eye."""
    side = max(config.image_size)
    turn, slant = draws.angle(), draws.uniform(0.1, 1.2)
    distance = draws.log_uniform(0.8 * side, 5.0 * side)
    lateral = distance * jnp.tan(slant) * 0.6
    depth = space.relief * space.high + distance
    lamp = jnp.stack([lateral * jnp.cos(turn), lateral * jnp.sin(turn), depth])
    # Pixels that a ray along the light moves per unit of disparity, limited so that shadows stay
    # within the shade maps.
    view_steps = jnp.minimum(jnp.tan(slant) * space.relief, 28.0 / (space.high - space.low))
    return Light(
        relief=space.relief,
        lamp=lamp,
        half_light_distance=distance * draws.uniform(0.7, 2.0),
        strength=draws.choose(config.shading, draws.uniform(0.3, 0.9)),
        direction=view_steps * jnp.stack([jnp.sin(turn), jnp.cos(turn)]),
        shadow=draws.choose(config.shadows, draws.uniform(0.4, 1.0)),
        softness=draws.log_uniform(0.7, 8.0),
        crease=draws.choose(config.creases, draws.uniform(0.2, 0.8)),
        convergence=draws.uniform(0.0, 0.6),
        swing=draws.log_uniform(0.5, 4.0),
    )
