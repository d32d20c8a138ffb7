"""Brightness of what rays of the fast generator meet.

Everything is fixed to the surfaces but highlights and reflections, which move with the view,
smoothly. Lengths are metric here: the third coordinate is ``relief * d``, in pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from occjax.data.patches import Geometry, Hits, first_hits, joined, pick, sample


class Materials(NamedTuple):
    """Looks of the surfaces, one entry each.

    Attributes:
        lay: ``[n, 2, 3]`` map from ``(X, Y, d)`` to texels, row and column.
        start: ``[n, 2]`` texel at the origin.
        texture: ``[n]`` index of the texture.
        detail: ``[n]`` index of a second texture, laid at ``detail_scale`` times the size.
        detail_scale: ``[n]``.
        tone: ``[n]`` mean reflectance.
        contrast: ``[n]`` relative strength of the texture.
        detail_contrast: ``[n]`` relative strength of the second texture.
        gloss: ``[n]`` strength of highlights.
        sharpness: ``[n]`` of highlights: the larger, the smaller they are.
        mirror: ``[n]`` strength of reflections.
    """

    lay: Float[Array, "n 2 3"]
    start: Float[Array, "n 2"]
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
    """A lamp, light from all around, and what they leave dark.

    Attributes:
        relief: Depth per unit of disparity, in pixels.
        lamp: ``[3]`` position of the lamp, metric.
        reach: Distance at which the lamp has lost half its light.
        strength: Share of the lamp in the light; the rest comes from all around.
        cast: ``[2]`` row and column offset of the view whose rays run along the light.
        shadow: Depth of the shadows in [0, 1].
        softness: Blur of the shadows, in pixels.
        crease: Depth of the darkness in corners and gaps, in [0, 1].
        surroundings: Index of the texture that is mirrored.
        convergence: How much the direction to the eye turns from pixel to pixel.
        swing: How much it turns from view to view, relative to the parallax.
    """

    relief: Float[Array, ""]
    lamp: Float[Array, "3"]
    reach: Float[Array, ""]
    strength: Float[Array, ""]
    cast: Float[Array, "2"]
    shadow: Float[Array, ""]
    softness: Float[Array, ""]
    crease: Float[Array, ""]
    surroundings: Int[Array, ""]
    convergence: Float[Array, ""]
    swing: Float[Array, ""]


class Shade(NamedTuple):
    """What light and openness every place has, as maps over the image and its surroundings.

    Attributes:
        blocker: ``[m, m]`` blurred exponential of the disparity first met along the light.
        front: ``[m, m]`` blurred disparity of the centre view.
        reach: ``[2]`` half the height and width that the maps cover, in pixels.
    """

    blocker: Float[Array, "m m"]
    front: Float[Array, "m m"]
    reach: Float[Array, "2"]


SHADE_SIZE = 128
"""Rows and columns of the maps of shadow and openness."""

HARDNESS = 24.0
"""Exponent of the shadow map across the whole range of disparity."""


def shade_maps(geometry: Geometry, light: Light, image_size: tuple[int, int]) -> Shade:
    """Render the scene along the light and from the front, coarsely, and blur.

    A parallel light that comes from the camera's side runs along the rays of some view, so the
    shadow map is that view's disparity: a point is lit where its ray is stopped at its own
    disparity. The blurred exponential of disparity makes shadows soft (exponential shadow maps).
    """
    reach = 0.5 * jnp.asarray(image_size, jnp.float32) + 32.0
    axis = jnp.linspace(-1.0, 1.0, SHADE_SIZE)
    y, x = jnp.meshgrid(axis * reach[0], axis * reach[1], indexing="ij")
    pixel = 2.0 * jnp.max(reach) / (SHADE_SIZE - 1)
    lowest, highest = geometry.limits
    along = first_hits(geometry, y, x, light.cast).disparity
    exponent = HARDNESS * (along - lowest) / (highest - lowest)
    front = first_hits(geometry, y, x, jnp.zeros(2)).disparity
    return Shade(_blur(jnp.exp(exponent), light.softness / pixel), _blur(front, 6.0 / pixel), reach)


def brightness(
    geometry: Geometry,
    materials: Materials,
    textures: Float[Array, "t m m"],
    light: Light,
    shade: Shade,
    offset: Float[Array, "2"],
    y: Float[Array, "*r"],
    x: Float[Array, "*r"],
    hits: Hits,
) -> Float[Array, "*r"]:
    """Brightness of the hits of rays of one view.

    Args:
        geometry: The scene.
        materials: Its looks, in the order of its surfaces.
        textures: ``[t, m, m]`` in [-1, 1].
        light: The light.
        shade: From :func:`shade_maps`.
        offset: ``[2]`` offset of the view.
        y: Row at which each ray meets the view's image, in pixels from the image centre.
        x: Column, likewise.
        hits: From :func:`~occjax.data.patches.first_hits`.

    Returns:
        Brightness, at least 0.
    """
    d, index = hits
    px, py, pz = x + offset[1] * d, y + offset[0] * d, light.relief * d

    def of(values):
        return pick(values, index)

    row = _affine(of, materials.lay[:, 0], materials.start[:, 0], px, py, d)
    column = _affine(of, materials.lay[:, 1], materials.start[:, 1], px, py, d)
    scale = of(materials.detail_scale)
    pattern = of(materials.contrast) * _texel(textures, of(materials.texture), row, column)
    detail = _texel(textures, of(materials.detail), row * scale, column * scale)
    pattern = pattern + of(materials.detail_contrast) * detail
    albedo = jnp.clip(of(materials.tone) * (1.0 + pattern), 0.0, 1.2)

    nx, ny, nz = _normals(geometry, light.relief, px, py, d, offset, index)
    lx, ly, lz = light.lamp[0] - px, light.lamp[1] - py, light.lamp[2] - pz
    squared = lx * lx + ly * ly + lz * lz
    inverse = jax.lax.rsqrt(squared)
    lx, ly, lz = lx * inverse, ly * inverse, lz * inverse
    falloff = 2.0 / (1.0 + squared / light.reach**2)
    lowest, highest = geometry.limits
    received = HARDNESS * (d - lowest) / (highest - lowest)
    blocker = sample(
        shade.blocker,
        (py - light.cast[0] * d) / shade.reach[0],
        (px - light.cast[1] * d) / shade.reach[1],
    )
    lit = jnp.clip(1.3 * jnp.exp(received) / blocker, 0.0, 1.0)
    lit = 1.0 - light.shadow * (1.0 - lit)
    sunken = sample(shade.front, py / shade.reach[0], px / shade.reach[1]) - d
    openness = 1.0 - light.crease * jnp.clip(sunken * light.relief / 12.0, 0.0, 1.0)
    facing = jnp.maximum(nx * lx + ny * ly + nz * lz, 0.0)
    lamp = light.strength * falloff * lit
    diffuse = albedo * (lamp * facing + (1.0 - light.strength) * openness)

    # Towards the eye of this view: it turns with the view and, in perspective, with the pixel.
    ex = light.swing * offset[1] - light.convergence * px
    ey = light.swing * offset[0] - light.convergence * py
    inverse = jax.lax.rsqrt(ex * ex + ey * ey + light.relief**2)
    ex, ey, ez = ex * inverse, ey * inverse, light.relief * inverse
    hx, hy, hz = ex + lx, ey + ly, ez + lz
    inverse = jax.lax.rsqrt(hx * hx + hy * hy + hz * hz + 1e-6)
    aligned = (nx * hx + ny * hy + nz * hz) * inverse
    highlight = of(materials.gloss) * jnp.exp(of(materials.sharpness) * (aligned - 1.0)) * lit
    outward = 2.0 * (nx * ex + ny * ey + nz * ez)
    mirrored = _texel(
        textures,
        jnp.broadcast_to(light.surroundings, d.shape),
        160.0 * (outward * ny - ey),
        160.0 * (outward * nx - ex),
    )
    return diffuse + highlight + of(materials.mirror) * (1.0 + mirrored) * openness


def _normals(geometry: Geometry, relief, px, py, d, offset, index):
    """Metric unit normals of the surfaces hit, towards the camera."""
    table = joined(geometry.walls, geometry.sheets, geometry.solids)

    def of(values):
        return pick(values, index)

    own = [_affine(of, table.linear[:, i], table.shift[:, i], px, py, d) for i in range(3)]
    # The faces of a solid's box are where a coordinate reaches half its size.
    level = of(table.constant) + of(table.slope) * own[2]
    for axis in range(3):
        level = level + of(table.curvature[:, axis]) * own[axis] ** 2
    excess = [jnp.abs(own[i]) * of(1.0 / table.half[:, i]) - 1.0 for i in range(3)]
    most = jnp.maximum(jnp.maximum(excess[0], excess[1]), excess[2])
    on_face = most > level
    gradient = []
    for axis in range(3):
        curved = 2.0 * of(table.curvature[:, axis]) * own[axis]
        curved = curved + of(table.slope) if axis == 2 else curved
        gradient.append(jnp.where(on_face, jnp.where(excess[axis] == most, own[axis], 0.0), curved))
    nx, ny, nd = (
        sum(of(table.linear[:, i, axis]) * gradient[i] for i in range(3)) for axis in range(3)
    )
    towards = nx * offset[1] + ny * offset[0] + nd
    nz = nd / relief
    scale = jnp.copysign(jax.lax.rsqrt(nx * nx + ny * ny + nz * nz + 1e-20), towards)
    return nx * scale, ny * scale, nz * scale


def _affine(of, rows, shift, px, py, d):
    """One component of an affine map, per ray."""
    return of(rows[:, 0]) * px + of(rows[:, 1]) * py + of(rows[:, 2]) * d + of(shift)


def _texel(textures, index, row, column):
    """Bilinear lookup in one texture per ray, in texels; textures repeat mirrored."""
    size = textures.shape[-1]
    whole_row, whole_column = jnp.floor(row), jnp.floor(column)
    part_row, part_column = row - whole_row, column - whole_column
    rows = [_mirrored(whole_row.astype(jnp.int32) + step, size) for step in (0, 1)]
    columns = [_mirrored(whole_column.astype(jnp.int32) + step, size) for step in (0, 1)]
    flat = textures.reshape(-1)
    first = index * (size * size)
    upper, lower = (
        pick(flat, first + line * size + columns[0]) * (1.0 - part_column)
        + pick(flat, first + line * size + columns[1]) * part_column
        for line in rows
    )
    return upper * (1.0 - part_row) + lower * part_row


def _mirrored(position, size):
    """Index into a row that repeats, every other time backwards; the size is a power of two."""
    within = position & (2 * size - 1)
    return jnp.where(within < size, within, 2 * size - 1 - within)


def _blur(image: Float[Array, "m m"], deviation: Float[Array, ""]) -> Float[Array, "m m"]:
    """Gaussian blur of a deviation in pixels; the border repeats."""
    position = jnp.arange(image.shape[0], dtype=jnp.float32)
    distance = position[:, None] - position[None, :]
    weight = jnp.exp(-0.5 * jnp.square(distance / jnp.maximum(deviation, 0.3)))
    weight = weight / jnp.sum(weight, axis=1, keepdims=True)
    return weight @ image @ weight.T
