"""Brightness of the surfaces that rays hit.

The brightness is fixed to the surfaces except for highlights and reflections, which move smoothly
with the view. Lengths are metric: the third coordinate is the depth ``relief * d``, in pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from occjax.data.procedural.surfaces import (
    Geometry,
    Hits,
    Quadrics,
    first_hits,
    sample_bilinear,
    take_unchecked,
)


class Materials(NamedTuple):
    """Materials of the surfaces, one entry each.

    Attributes:
        texel_map: ``[n, 2, 3]`` map from ``(X, Y, d)`` to texels, row and column.
        texel_origin: ``[n, 2]`` texel at the origin.
        texture: ``[n]`` index of the texture.
        detail: ``[n]`` index of a second texture.
        detail_scale: ``[n]`` factor on the texel coordinates of the second texture.
        tone: ``[n]`` mean reflectance.
        contrast: ``[n]`` relative strength of the texture.
        detail_contrast: ``[n]`` relative strength of the second texture.
        gloss: ``[n]`` strength of highlights.
        sharpness: ``[n]`` exponent of highlights; larger values give smaller highlights.
        mirror: ``[n]`` strength of reflections.
    """

    texel_map: Float[Array, "n 2 3"]
    texel_origin: Float[Array, "n 2"]
    texture: Int[Array, " n"]
    detail: Int[Array, " n"]
    detail_scale: Float[Array, " n"]
    tone: Float[Array, " n"]
    contrast: Float[Array, " n"]
    detail_contrast: Float[Array, " n"]
    gloss: Float[Array, " n"]
    sharpness: Float[Array, " n"]
    mirror: Float[Array, " n"]


class Light(NamedTuple):
    """A lamp, ambient light, shadows, and the direction to the eye.

    Attributes:
        relief: Depth per unit of disparity, in pixels.
        lamp: ``[3]`` position of the lamp, metric.
        half_light_distance: Distance at which the lamp has lost half its light, metric.
        strength: Fraction of the light that comes from the lamp; the rest is ambient.
        direction: ``[2]`` direction of the light: offset ``(row, column)`` of the view whose rays
            are parallel to it.
        shadow: Strength of the shadows, in [0, 1].
        softness: Blur of the shadows, in pixels.
        crease: Strength of the ambient occlusion in corners and gaps, in [0, 1].
        convergence: Change of the direction to the eye per pixel, as in a perspective image.
        swing: Change of this direction per view step.
    """

    relief: Float[Array, ""]
    lamp: Float[Array, "3"]
    half_light_distance: Float[Array, ""]
    strength: Float[Array, ""]
    direction: Float[Array, "2"]
    shadow: Float[Array, ""]
    softness: Float[Array, ""]
    crease: Float[Array, ""]
    convergence: Float[Array, ""]
    swing: Float[Array, ""]


class ShadeMaps(NamedTuple):
    """Maps for shadows and ambient occlusion, over the image and its surroundings.

    Attributes:
        shadow: ``[m, m]`` exponential shadow map: blurred exponential of the disparity of the first
            hit along the light.
        disparity: ``[m, m]`` blurred disparity of the centre view.
        half_extent: ``[2]`` half the height and width that the maps cover, in pixels.
    """

    shadow: Float[Array, "m m"]
    disparity: Float[Array, "m m"]
    half_extent: Float[Array, "2"]


def shade_maps(geometry: Geometry, light: Light, image_size: tuple[int, int]) -> ShadeMaps:
    """Render blurred disparity maps of low resolution, along the light and from the front.

    Parallel light from the side of the camera has the direction of the rays of some view. The
    shadow map is therefore the disparity of that view: a point is lit if the first hit along the
    light has its disparity. The blurred exponential of disparity makes shadows soft (exponential
    shadow maps, Annen et al., 2008).
    """
    half_extent = 0.5 * jnp.asarray(image_size, jnp.float32) + 32.0
    size = 128  # rows and columns of the maps
    axis = jnp.linspace(-1.0, 1.0, size)
    y, x = jnp.meshgrid(axis * half_extent[0], axis * half_extent[1], indexing="ij")
    pixel_size = 2.0 * jnp.max(half_extent) / (size - 1)
    exponent = _shadow_exponent(geometry, first_hits(geometry, y, x, light.direction).disparity)
    disparity = first_hits(geometry, y, x, jnp.zeros(2)).disparity
    return ShadeMaps(
        shadow=_blur(jnp.exp(exponent), light.softness / pixel_size),
        disparity=_blur(disparity, 6.0 / pixel_size),
        half_extent=half_extent,
    )


def brightness(
    geometry: Geometry,
    materials: Materials,
    textures: Float[Array, "t m m"],
    light: Light,
    shade: ShadeMaps,
    offset: Float[Array, "2"],
    y: Float[Array, "*r"],
    x: Float[Array, "*r"],
    hits: Hits,
) -> Float[Array, "*r"]:
    """Compute the brightness at the hits of rays of one view.

    Args:
        geometry: The scene.
        materials: Materials, in the order of the surfaces.
        textures: ``[t, m, m]`` in [-1, 1].
        light: The light.
        shade: Maps from :func:`shade_maps`.
        offset: ``[2]`` offset of the view.
        y: Row at which each ray meets the view's image, in pixels from the image centre.
        x: Column of the same point.
        hits: First hits from :func:`~occjax.data.procedural.surfaces.first_hits`.

    Returns:
        Brightness, at least 0.
    """
    d, index = hits
    point = x + offset[1] * d, y + offset[0] * d, light.relief * d
    px, py, _ = point

    def gather(values):  # one entry per surface to one per ray
        return take_unchecked(values, index)

    def sample(shade_map, y, x):  # in pixels from the image centre
        return sample_bilinear(shade_map, y / shade.half_extent[0], x / shade.half_extent[1])

    row, column = _affine(gather, materials.texel_map, materials.texel_origin, px, py, d)
    scale = gather(materials.detail_scale)
    pattern = gather(materials.contrast) * _texel(textures, gather(materials.texture), row, column)
    detail = _texel(textures, gather(materials.detail), row * scale, column * scale)
    pattern = pattern + gather(materials.detail_contrast) * detail
    albedo = jnp.clip(gather(materials.tone) * (1.0 + pattern), 0.0, 1.2)

    normal = _normals(gather, geometry.surfaces, light.relief, px, py, d, offset)
    to_lamp = [light.lamp[axis] - point[axis] for axis in range(3)]
    falloff = 2.0 / (1.0 + _dot(to_lamp, to_lamp) / light.half_light_distance**2)
    to_lamp = _unit(to_lamp)
    shadow = sample(shade.shadow, py - light.direction[0] * d, px - light.direction[1] * d)
    lit = jnp.clip(1.3 * jnp.exp(_shadow_exponent(geometry, d)) / shadow, 0.0, 1.0)
    lit = 1.0 - light.shadow * (1.0 - lit)
    sunken = sample(shade.disparity, py, px) - d  # below the surroundings, in disparity
    openness = 1.0 - light.crease * jnp.clip(sunken * light.relief / 12.0, 0.0, 1.0)
    facing = jnp.maximum(_dot(normal, to_lamp), 0.0)
    lamp = light.strength * falloff * lit
    diffuse = albedo * (lamp * facing + (1.0 - light.strength) * openness)

    # Direction to the eye: it changes with the view and, in perspective, with the pixel.
    ex = light.swing * offset[1] - light.convergence * px
    ey = light.swing * offset[0] - light.convergence * py
    eye = _unit([ex, ey, light.relief])
    # Highlights are brightest where the normal is halfway between light and eye (Blinn, 1977).
    halfway = [eye[axis] + to_lamp[axis] for axis in range(3)]
    aligned = _dot(normal, halfway) * jax.lax.rsqrt(_dot(halfway, halfway) + 1e-6)
    sharpness = gather(materials.sharpness)
    highlight = gather(materials.gloss) * jnp.exp(sharpness * (aligned - 1.0)) * lit
    # Reflections show the first texture.
    outward = 2.0 * _dot(normal, eye)
    mirrored = _texel(
        textures,
        jnp.zeros_like(index),
        160.0 * (outward * normal[1] - eye[1]),
        160.0 * (outward * normal[0] - eye[0]),
    )
    return diffuse + highlight + gather(materials.mirror) * (1.0 + mirrored) * openness


def _dot(a: Sequence[Array], b: Sequence[Array]) -> Array:
    """Return the dot product of vectors whose three components are arrays."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _unit(vector: Sequence[Array]) -> list[Array]:
    """Return vectors, whose three components are arrays, scaled to length 1."""
    inverse = jax.lax.rsqrt(_dot(vector, vector))
    return [component * inverse for component in vector]


def _shadow_exponent(geometry: Geometry, disparity):
    """Return the exponent of the shadow map: 24 at the highest disparity of the scene.

    Larger exponents make shadows sharper at contacts, up to the overflow of single precision at 88.
    """
    lowest, highest = geometry.disparity_range
    return 24.0 * (disparity - lowest) / (highest - lowest)


def _normals(gather, surfaces: Quadrics, relief, px, py, d, offset):
    """Return metric unit normals of the surfaces that are hit, towards the camera."""
    local = _affine(gather, surfaces.matrix, surfaces.translation, px, py, d)
    # A point is on a face of a solid's box where a coordinate reaches the half extent.
    level = gather(surfaces.constant) + gather(surfaces.linear) * local[2]
    for axis in range(3):
        level = level + gather(surfaces.quadratic[:, axis]) * local[axis] ** 2
    excess = [jnp.abs(local[i]) * gather(1.0 / surfaces.half_extent[:, i]) - 1.0 for i in range(3)]
    most = jnp.maximum(jnp.maximum(excess[0], excess[1]), excess[2])
    on_face = most > level
    gradient = []
    for axis in range(3):
        curved = 2.0 * gather(surfaces.quadratic[:, axis]) * local[axis]
        curved = curved + gather(surfaces.linear) if axis == 2 else curved
        gradient.append(
            jnp.where(on_face, jnp.where(excess[axis] == most, local[axis], 0.0), curved)
        )
    nx, ny, nd = (
        sum(gather(surfaces.matrix[:, i, axis]) * gradient[i] for i in range(3))
        for axis in range(3)
    )
    facing = nx * offset[1] + ny * offset[0] + nd
    nz = nd / relief
    scale = jnp.copysign(jax.lax.rsqrt(nx * nx + ny * ny + nz * nz + 1e-20), facing)
    return nx * scale, ny * scale, nz * scale


def _affine(gather, matrix, translation, px, py, d):
    """Return the components of the affine map of the surface that each ray hits."""
    return [
        gather(matrix[:, i, 0]) * px
        + gather(matrix[:, i, 1]) * py
        + gather(matrix[:, i, 2]) * d
        + gather(translation[:, i])
        for i in range(matrix.shape[1])
    ]


def _texel(textures, index, row, column):
    """Interpolate bilinearly in one texture per ray, in texels; textures repeat mirrored."""
    size = textures.shape[-1]
    top_row, left_column = jnp.floor(row), jnp.floor(column)
    row_fraction, column_fraction = row - top_row, column - left_column
    rows = [_mirrored(top_row.astype(jnp.int32) + step, size) for step in (0, 1)]
    columns = [_mirrored(left_column.astype(jnp.int32) + step, size) for step in (0, 1)]
    flat = textures.reshape(-1)
    first = index * (size * size)
    upper, lower = (
        take_unchecked(flat, first + line * size + columns[0]) * (1.0 - column_fraction)
        + take_unchecked(flat, first + line * size + columns[1]) * column_fraction
        for line in rows
    )
    return upper * (1.0 - row_fraction) + lower * row_fraction


def _mirrored(position, size):
    """Return the index into a row that repeats mirrored; the size is a power of two."""
    within = position & (2 * size - 1)
    return jnp.where(within < size, within, 2 * size - 1 - within)


def _blur(image: Float[Array, "m m"], deviation: Float[Array, ""]) -> Float[Array, "m m"]:
    """Blur with a Gaussian of a standard deviation in pixels, normalised at the border."""
    position = jnp.arange(image.shape[0], dtype=jnp.float32)
    distance = position[:, None] - position[None, :]
    weight = jnp.exp(-0.5 * jnp.square(distance / jnp.maximum(deviation, 0.3)))
    weight = weight / jnp.sum(weight, axis=1, keepdims=True)
    return weight @ image @ weight.T
