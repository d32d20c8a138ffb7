"""Solid textures: the colour of a surface as a function of the point on it.

A texture is evaluated at a point of the surface's own coordinates, so it sticks to the surface and
every view sees the same colours: the photo-consistency that disparity is estimated from. All
patterns are computed for every point and one is chosen, which is what lets a scene be an array.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

Scalar = float | int | Float[Array, ""]
"""A number, or a traced one in a scene that is drawn at random."""

Triple = tuple[Scalar, ...]
"""A colour, or one number for each axis."""

PATTERNS = ("plain", "checks", "stripes", "bricks", "wood", "marble", "planks", "spots", "weave")
"""Names of the patterns; a material's ``pattern`` is an index into this tuple."""


class Materials(NamedTuple):
    """What surfaces look like, one entry per surface.

    Attributes:
        pattern: ``[n]`` int32, index into :data:`PATTERNS`.
        colours: ``[n, 3, 3]`` linear RGB: ground, pattern, and joints or accents.
        frequency: ``[n, 3]`` texture periods per unit of the surface's own coordinates.
        grain: ``[n]`` strength of the multi-octave noise that mottles every pattern.
        gloss: ``[n]`` strength of the highlight.
        seed: ``[n]`` offset that makes equal patterns differ.
        around: ``[n]`` 1 where the texture is laid around the z axis (angle, height) like a label
            on a jar, 0 where it fills space.
    """

    pattern: Int[Array, " n"]
    colours: Float[Array, "n 3 3"]
    frequency: Float[Array, "n 3"]
    grain: Float[Array, " n"]
    gloss: Float[Array, " n"]
    seed: Float[Array, " n"]
    around: Float[Array, " n"]


def material(
    pattern: str | Int[Array, ""] = "plain",
    *,
    ground: Triple = (0.6, 0.6, 0.6),
    figure: Triple | None = None,
    accent: Triple | None = None,
    frequency: Triple | Scalar = 0.1,
    grain: Scalar = 0.25,
    gloss: Scalar = 0.0,
    seed: Scalar = 0.0,
    around: bool = False,
) -> Materials:
    """One material, as arrays of length one.

    Args:
        pattern: One of :data:`PATTERNS`, or its index.
        ground: sRGB colour of the ground, each channel in [0, 1].
        figure: sRGB colour of the pattern; a darker ground if not given.
        accent: sRGB colour of joints, veins and accents; the figure's colour if not given.
        frequency: Texture periods per unit of the surface's own coordinates, along x, y and z.
        grain: Strength of the multi-octave noise on top, in [0, 1].
        gloss: Strength of the highlight, in [0, 1].
        seed: Any number; different seeds give different instances of the pattern.
        around: Lay the texture around the z axis.

    Returns:
        Arrays with a leading axis of length 1; see :func:`occjax.data.surfaces.join`.
    """
    number = PATTERNS.index(pattern) if isinstance(pattern, str) else pattern
    figure = tuple(0.6 * channel for channel in ground) if figure is None else figure
    accent = figure if accent is None else accent
    return Materials(
        pattern=jnp.array([number], jnp.int32),
        colours=linear_from_srgb(jnp.array([[ground, figure, accent]], jnp.float32)),
        frequency=jnp.broadcast_to(jnp.asarray(frequency, jnp.float32), (1, 3)),
        grain=jnp.array([grain], jnp.float32),
        gloss=jnp.array([gloss], jnp.float32),
        seed=jnp.array([seed], jnp.float32),
        around=jnp.array([around], jnp.float32),
    )


def albedo(materials: Materials, points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Linear RGB reflectance of each material at one point of its surface.

    Args:
        materials: One entry per point.
        points: ``[n, 3]`` in the coordinates of the surface that the point lies on.

    Returns:
        ``[n, 3]`` reflectance in [0, 1].
    """
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    turn = jnp.arctan2(y, x) / (2.0 * jnp.pi)
    laid_around = jnp.stack([turn, z, jnp.zeros_like(z)], axis=-1)
    place = jnp.where(materials.around[:, None] > 0.0, laid_around, points) * materials.frequency
    # Grain comes from space, not from the unrolled label: the latter has a seam.
    space = points * jnp.where(
        materials.around[:, None] > 0.0, materials.frequency[:, 1:2], materials.frequency
    )
    shifted = space + materials.seed[:, None] * jnp.array([[17.3, 31.7, 5.1]])
    fibrous = shifted * jnp.array([[0.35, 4.0, 4.0]]) + 40.0
    cloud, fibre, speckle = jax.lax.map(
        fractal_noise, jnp.stack([shifted, fibrous, shifted * 7.0 + 90.0])
    )
    figure, accent, tone = _pattern(materials, place, cloud, fibre)

    ground, pattern_colour, accent_colour = jnp.moveaxis(materials.colours, 1, 0)
    colour = ground + (pattern_colour - ground) * figure[:, None]
    colour = colour + (accent_colour - colour) * accent[:, None]
    mottling = 1.0 + materials.grain * (1.6 * (cloud - 0.5) + 1.2 * (speckle - 0.5))
    return jnp.clip(colour * (mottling * tone)[:, None], 0.0, 1.0)


def _pattern(
    materials: Materials,
    place: Float[Array, "n 3"],
    cloud: Float[Array, " n"],
    fibre: Float[Array, " n"],
) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]:
    """Amount of figure and of accent in [0, 1], and a factor on the brightness."""
    x, y, z = place[:, 0], place[:, 1], place[:, 2]
    zero, one = jnp.zeros_like(x), jnp.ones_like(x)

    checks = jnp.mod(jnp.floor(x) + jnp.floor(y) + jnp.floor(z + 1e-3), 2.0)
    across = x + y + z  # a frequency of zero along two axes makes stripes across the third
    stripes = _band(_triangle(across), 0.5, 0.04)
    fine_stripes = 1.0 - _band(_triangle(across + 0.25), 0.10, 0.03)

    course = jnp.floor(y)
    along = x + 0.5 * jnp.mod(course, 2.0)
    brick_tone = _hash_unit(jnp.floor(along), course, materials.seed)
    joint = jnp.maximum(_joint(along, 0.035), _joint(y, 0.07))

    board = jnp.floor(y)
    board_tone = _hash_unit(board, zero, materials.seed)
    start = x + 3.7 * board_tone
    plank_tone = _hash_unit(board, jnp.floor(start), materials.seed)
    gap = jnp.maximum(_joint(start, 0.006), _joint(y, 0.02))

    radius = jnp.hypot(y + 1.3, z + 0.7) + 0.35 * (cloud - 0.5) + 0.25 * fibre
    rings = _triangle(3.0 * radius) ** 1.5
    grain_lines = _band(_triangle(2.0 * (y + 1.5 * plank_tone) + 5.0 * cloud), 0.45, 0.45)

    veins = jnp.exp(-14.0 * jnp.abs(_triangle(0.7 * (x + y + z) + 2.5 * cloud) - 0.5))
    spots = _spots(place, materials.seed)
    over = jnp.mod(jnp.floor(x) + jnp.floor(y), 2.0)
    thread = jnp.where(over > 0.0, _triangle(x + 0.5), _triangle(y + 0.5))

    wood = 0.25 * cloud + 0.75 * (0.6 * rings + 0.4 * fibre)
    plank = 0.5 * grain_lines + 0.5 * fibre
    choices = [  # in the order of PATTERNS
        (0.6 * cloud, zero, one),
        (checks, zero, one),
        (stripes, fine_stripes, one),
        (brick_tone, joint, 0.8 + 0.4 * cloud),
        (wood, zero, 0.85 + 0.3 * fibre),
        (0.7 * cloud, veins, one),
        (plank, gap, 0.75 + 0.35 * plank_tone + 0.15 * fibre),
        (spots, zero, one),
        (over, zero, 0.7 + 0.5 * thread),
    ]
    figure, accent, tone = (jnp.stack(parts) for parts in zip(*choices, strict=True))

    def chosen(parts):
        return jnp.take_along_axis(parts, materials.pattern[None], axis=0)[0]

    return chosen(figure), chosen(accent), chosen(tone)


def fractal_noise(points: Float[Array, "n 3"], octaves: int = 4) -> Float[Array, " n"]:
    """Sum of smooth value noise over octaves, each twice as fine and half as strong.

    Random values at integer points are interpolated smoothly. Octaves and the corners of a cell are
    array axes, not unrolled: compiling would take ten times as long.

    Args:
        points: ``[n, 3]``; the coarsest octave has one random value per unit cell.
        octaves: Number of octaves.

    Returns:
        ``[n]`` in [0, 1], about 0.5 on average.
    """
    octave = jnp.arange(octaves, dtype=points.dtype)
    # The shift keeps lattice planes of the octaves from coinciding at the origin.
    scaled = points.T[:, None] * 2.0 ** octave[None, :, None] + 19.19 * octave[None, :, None]
    cell = jnp.floor(scaled)[:, :, None]
    fraction = scaled[:, :, None] - cell
    smooth = fraction * fraction * fraction * (fraction * (fraction * 6.0 - 15.0) + 10.0)
    corner = jnp.asarray(np.indices((2, 2, 2)).reshape(3, 1, 8, 1), points.dtype)
    weight = jnp.prod(jnp.where(corner > 0.0, smooth, 1.0 - smooth), axis=0)
    values = jnp.sum(weight * _hash_unit(*(cell + corner)), axis=1)
    strength = 0.5**octave
    return jnp.sum(strength[:, None] * values, axis=0) / jnp.sum(strength)


def _spots(place: Float[Array, "n 3"], seed: Float[Array, " n"]) -> Float[Array, " n"]:
    """Round spots of random size, one per unit cell, kept inside their cell."""
    cell = jnp.floor(place)
    inside = place - cell - 0.5
    size = 0.2 + 0.22 * _hash_unit(cell[:, 0] + seed, cell[:, 1], cell[:, 2])
    return 1.0 - _band(jnp.linalg.norm(inside, axis=-1), size, 0.04)


def _hash_unit(
    i: Float[Array, "*n"], j: Float[Array, "*n"], k: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Pseudo-random numbers in [0, 1) of integer coordinates, the same on every device."""

    def mixed(state, value):
        whole = jnp.floor(value).astype(jnp.int32).astype(jnp.uint32)
        state = (state ^ whole) * jnp.uint32(0x9E3779B1)
        state = (state ^ (state >> 15)) * jnp.uint32(0x85EBCA6B)
        return state ^ (state >> 13)

    state = jnp.full(i.shape, 0x2545F491, jnp.uint32)
    for value in (i, j, k):
        state = mixed(state, value)
    return (state >> 8).astype(i.dtype) * (1.0 / 2**24)


def _triangle(value: Float[Array, " n"]) -> Float[Array, " n"]:
    """Triangle wave of period 1 between 0 and 1."""
    return jnp.abs(2.0 * (value - jnp.floor(value)) - 1.0)


def _joint(value: Float[Array, " n"], width: float) -> Float[Array, " n"]:
    """1 within ``width`` of a whole number, falling to 0."""
    distance = 0.5 * (1.0 - jnp.abs(2.0 * (value - jnp.floor(value)) - 1.0))
    return 1.0 - _band(distance, width, 0.3 * width)


def _band(
    value: Float[Array, " n"], edge: Float[Array, " n"] | float, softness: float
) -> Float[Array, " n"]:
    """Smooth step from 0 below ``edge`` to 1 above it."""
    position = jnp.clip((value - edge) / (2.0 * softness) + 0.5, 0.0, 1.0)
    return position * position * (3.0 - 2.0 * position)


def linear_from_srgb(colour: Float[Array, "... 3"]) -> Float[Array, "... 3"]:
    """Decode the sRGB transfer function: display values in [0, 1] to linear light.

    Example:
        >>> [round(float(light), 3) for light in linear_from_srgb(jnp.array([0.0, 0.5, 1.0]))]
        [0.0, 0.214, 1.0]
    """
    toe = colour / 12.92
    return jnp.where(colour <= 0.04045, toe, ((jnp.maximum(colour, 0.0) + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(light: Float[Array, "... 3"]) -> Float[Array, "... 3"]:
    """Encode linear light in [0, 1] with the sRGB transfer function.

    Example:
        >>> [round(float(value), 3) for value in srgb_from_linear(jnp.array([0.0, 0.2140, 1.0]))]
        [0.0, 0.5, 1.0]
    """
    curve = 1.055 * jnp.maximum(light, 0.0031308) ** (1.0 / 2.4) - 0.055
    return jnp.where(light <= 0.0031308, 12.92 * light, curve)


def take(materials: Materials, index: Int[Array, " n"]) -> Materials:
    """The materials of the surfaces that rays have hit."""
    return jax.tree.map(lambda values: values[index], materials)
