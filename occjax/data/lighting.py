"""Light on surfaces: a soft lamp, the sky, and highlights.

Light depends only on where a point is, never on the view that looks at it: shadows are fixed to
their surfaces, and highlights are those of the centre view. That keeps a rendered light field
photo-consistent, which real glossy things are not.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from occjax.data.surfaces import Surfaces, first_hits, normals, own_points
from occjax.data.textures import albedo, take


class Lighting(NamedTuple):
    """A round lamp far away, light from all around, and light reflected from below.

    Attributes:
        direction: ``[3]`` unit vector towards the lamp, in scene coordinates.
        softness: Radius of the lamp as seen from the scene, in radians.
        lamp: ``[3]`` linear RGB of the lamp.
        sky: ``[3]`` linear RGB from above.
        bounce: ``[3]`` linear RGB from below.
        reach: Distance within which surfaces darken each other's corners, in pixels.
    """

    direction: Float[Array, "3"]
    softness: Float[Array, ""]
    lamp: Float[Array, "3"]
    sky: Float[Array, "3"]
    bounce: Float[Array, "3"]
    reach: Float[Array, ""]


class Seen(NamedTuple):
    """What rays have met.

    Attributes:
        surface: ``[r]`` index of the surface.
        points: ``[r, 3]`` points on it, in scene coordinates.
        directions: ``[r, 3]`` directions in which the rays came.
    """

    surface: Int[Array, " r"]
    points: Float[Array, "r 3"]
    directions: Float[Array, "r 3"]


def light_from(
    surfaces: Surfaces,
    lighting: Lighting,
    seen: Seen,
    eye: Float[Array, "3"],
    lamp_points: Float[Array, "r 2"],
    sky_points: Float[Array, "r 2"],
) -> Float[Array, "r 3"]:
    """Linear RGB that comes from points of surfaces.

    Each point looks at one part of the lamp and at one part of the sky; the average over many, as
    that of a pixel's rays, has soft shadows.

    Args:
        surfaces: The scene.
        lighting: The lights.
        seen: Where to look.
        eye: ``[3]`` position of the centre camera, for highlights.
        lamp_points: ``[r, 2]`` points of the unit disc: parts of the lamp.
        sky_points: ``[r, 2]`` points of the unit disc: parts of the sky.

    Returns:
        ``[r, 3]`` in [0, 1].
    """
    own = own_points(surfaces, seen.surface, seen.points)
    materials = take(surfaces.materials, seen.surface)
    colour = albedo(materials, own)

    normal = normals(surfaces, seen.surface, own)
    facing = jnp.sum(normal * seen.directions, axis=-1, keepdims=True) < 0.0
    normal = jnp.where(facing, normal, -normal)
    lifted = seen.points + 0.02 * normal  # a shadow ray must not meet the surface that it leaves

    lamp_direction = _towards(lighting.direction[None], lighting.softness * lamp_points)
    cosine = jnp.maximum(jnp.sum(normal * lamp_direction, axis=-1), 0.0)
    shadowed = jnp.isfinite(first_hits(surfaces, lifted, lamp_direction, 0.0).distance)
    lamp = jnp.where(shadowed[:, None], 0.0, lighting.lamp[None])

    # Points of a disc raised onto the hemisphere above it are distributed as its cosine.
    sky_direction = _hemisphere(normal, sky_points)
    blocked = first_hits(surfaces, lifted, sky_direction, 0.0).distance
    openness = jnp.clip(blocked / lighting.reach, 0.0, 1.0)
    upward = 0.5 - 0.5 * normal[:, 1:2]
    ambient = lighting.bounce[None] + (lighting.sky - lighting.bounce)[None] * upward

    to_eye = eye[None] - seen.points
    to_eye = to_eye / jnp.linalg.norm(to_eye, axis=-1, keepdims=True)
    half = lighting.direction[None] + to_eye
    half = half / jnp.linalg.norm(half, axis=-1, keepdims=True)
    alignment = jnp.maximum(jnp.sum(normal * half, axis=-1), 0.0)
    highlight = materials.gloss * (alignment**60.0 + 0.15 * alignment**8.0)

    diffuse = colour * (cosine[:, None] * lamp + openness[:, None] * ambient)
    light = diffuse + highlight[:, None] * lamp
    return jnp.clip(light, 0.0, 1.0)


def sampling_patterns(count: int) -> tuple[Float[Array, "k 2"], Float[Array, "k 2"]]:
    """Evenly spread points of the unit disc for the lamp and for the sky, in unrelated orders."""
    index = np.arange(count)
    radius, angle = np.sqrt((index + 0.5) / count), index * np.pi * (3.0 - np.sqrt(5.0))
    spiral = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    order = np.random.default_rng(0)
    lamp, sky = spiral[order.permutation(count)], spiral[order.permutation(count)]
    return jnp.asarray(lamp, jnp.float32), jnp.asarray(sky, jnp.float32)


def _towards(axis: Float[Array, "#r 3"], disc: Float[Array, "r 2"]) -> Float[Array, "r 3"]:
    """Unit vectors around an axis, displaced from it by points of a disc."""
    first, second = _tangents(axis)
    vector = axis + disc[:, :1] * first + disc[:, 1:] * second
    return vector / jnp.linalg.norm(vector, axis=-1, keepdims=True)


def _hemisphere(normal: Float[Array, "r 3"], disc: Float[Array, "r 2"]) -> Float[Array, "r 3"]:
    """Unit vectors above a surface, whose projections onto it are the points of the unit disc."""
    first, second = _tangents(normal)
    height = jnp.sqrt(jnp.maximum(1.0 - jnp.sum(disc**2, axis=-1, keepdims=True), 1e-6))
    return disc[:, :1] * first + disc[:, 1:] * second + height * normal


def _tangents(normal: Float[Array, "r 3"]) -> tuple[Float[Array, "r 3"], Float[Array, "r 3"]]:
    """Two unit vectors at right angles to each normal and to each other."""
    helper = jnp.where(
        jnp.abs(normal[:, 1:2]) > 0.9, jnp.array([[1.0, 0.0, 0.0]]), jnp.array([[0.0, 1.0, 0.0]])
    )
    first = jnp.cross(helper, normal)
    first = first / jnp.linalg.norm(first, axis=-1, keepdims=True)
    return first, jnp.cross(normal, first)
