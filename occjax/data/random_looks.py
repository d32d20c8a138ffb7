"""What random scenes look like: materials of their surfaces, and light."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from occjax.data.draws import Draws
from occjax.data.patches import Geometry, joined
from occjax.data.scene_config import SceneConfig
from occjax.data.shading import Light, Materials


class Space(NamedTuple):
    """Where the surfaces of a scene may be.

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
    """Draw the looks of all surfaces.

    Args:
        draws: Random numbers.
        config: The distribution.
        space: Where the surfaces are.
        geometry: The surfaces.
        group: Index of the solid that each solid looks like.

    Returns:
        One entry for each wall, sheet and solid.
    """
    table = joined(geometry.walls, geometry.sheets, geometry.solids)
    count = table.slope.shape[0]
    scene, draws = draws, draws.of((count,))
    texture_count = config.texture_count

    def index():
        return jnp.minimum((draws.unit() * texture_count).astype(jnp.int32), texture_count - 1)

    texture, detail = index(), index()
    calm = jnp.where(scene.chance(config.calm), 0.08, 1.0)
    contrast = draws.sometimes(
        config.low_contrast, draws.log_uniform(0.008, 0.06), draws.uniform(0.1, 0.9)
    )
    contrast = draws.sometimes(config.textureless, 0.0, calm * contrast)
    strong = draws.sometimes(0.5, 0.0, draws.log_uniform(0.03, 0.6))
    detail_contrast = jnp.where(contrast > 0.0, jnp.minimum(strong, contrast), 0.0)
    tone = draws.uniform(0.04, 0.9)
    alike = draws.chance(config.similar)
    # Followers in a group look like its leader, and some things like the wall.
    first_solid = count - config.solids
    leaders = jnp.concatenate([jnp.arange(first_solid), first_solid + group])
    like = jnp.where(alike[leaders], min(1, config.walls - 1), leaders)
    varied = 1.0 + draws.sometimes(0.6, draws.uniform(-0.12, 0.12))

    # Texels are laid along the surface: two directions at right angles to its own z axis.
    normal = table.linear[:, 2].at[:, 2].divide(space.relief)
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
    texels = draws.log_uniform(0.4, 1.5)[like]
    lay = jnp.stack([first, second], axis=1) * texels[:, None, None]
    lay = lay.at[:, :, 2].multiply(space.relief)
    start = jnp.stack([draws.uniform(0.0, 256.0), draws.uniform(0.0, 256.0)], axis=-1)

    glossy = scene.chance(config.highlights)
    gloss = draws.sometimes(0.6, draws.uniform(0.1, 0.7)) * jnp.where(glossy, 1.0, 0.0)
    mirrors = scene.chance(config.reflections)
    mirror = draws.sometimes(0.4, draws.uniform(0.02, 0.15)) * jnp.where(mirrors, 1.0, 0.0)
    return Materials(
        lay=lay,
        start=start,
        texture=texture[like],
        detail=detail[like],
        detail_scale=draws.log_uniform(0.2, 1.0),
        tone=(tone[like] * varied),
        contrast=contrast[like],
        detail_contrast=detail_contrast[like],
        gloss=gloss[leaders],
        sharpness=draws.log_uniform(6.0, 250.0)[leaders],
        mirror=mirror[leaders],
    )


def draw_light(draws: Draws, config: SceneConfig, space: Space) -> Light:
    """Draw where the lamp is, and how dark it is without it."""
    side = max(config.image_size)
    turn, slant = draws.angle(), draws.uniform(0.1, 1.2)
    distance = draws.log_uniform(0.8 * side, 5.0 * side)
    away = distance * jnp.tan(slant) * 0.6
    front = space.relief * space.high + distance
    lamp = jnp.stack([away * jnp.cos(turn), away * jnp.sin(turn), front])
    # Rays along the light move by this much per unit of disparity; too far would leave the map.
    reach = jnp.minimum(jnp.tan(slant) * space.relief, 28.0 / (space.high - space.low))
    cast = reach * jnp.stack([jnp.sin(turn), jnp.cos(turn)])
    return Light(
        relief=space.relief,
        lamp=lamp,
        reach=distance * draws.uniform(0.7, 2.0),
        strength=draws.sometimes(config.shading, draws.uniform(0.3, 0.9)),
        cast=cast,
        shadow=draws.sometimes(config.shadows, draws.uniform(0.4, 1.0)),
        softness=draws.log_uniform(0.7, 8.0),
        crease=draws.sometimes(config.creases, draws.uniform(0.2, 0.8)),
        surroundings=jnp.zeros((), jnp.int32),
        convergence=draws.uniform(0.0, 0.6),
        swing=draws.log_uniform(0.5, 4.0),
    )
