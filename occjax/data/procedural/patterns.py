"""Textures and outlines: small images that are drawn for each scene and looked up by its rays.

A bilinear lookup costs a fraction of evaluating noise of many octaves. Textures cover surfaces at
about one texel per pixel, so their detail is as fine as the views can show.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from occjax.data.procedural.config import Outlines, Textures
from occjax.data.procedural.draws import Draws, Key

SIZE = 256
"""Rows and columns of textures and outlines; a power of two."""


def textures(
    draws: Draws, noise_key: Key, count: int, kinds: Textures
) -> Float[Array, "count 256 256"]:
    """Draw textures, of values in [-1, 1] with a mean of about zero."""
    draws = draws.with_shape((count, 1, 1))
    exponent = draws.uniform(0.3, 2.2)
    stretch = draws.choose(0.4, draws.log_uniform(1.0, 6.0), 1.0)
    first, second = noise(noise_key, exponent, draws.angle(), stretch, draws.log_uniform(1.0, 8.0))
    # Plain noise, noise with hard edges, or noise folded into veins.
    character, strength = draws.unit(), draws.log_uniform(1.0, 8.0)
    clouds = jnp.where(
        character < 0.55,
        jnp.clip(first / 2.5, -1.0, 1.0),
        jnp.where(
            character < 0.8, jnp.tanh(strength * first), jnp.tanh(1.0 - 2.0 * jnp.abs(first))
        ),
    )

    angle, period = draws.angle(), draws.log_uniform(5.0, 50.0)
    warp = draws.choose(0.5, draws.uniform(0.0, 0.5) ** 2)
    down, across = jnp.meshgrid(*(jnp.arange(SIZE, dtype=jnp.float32),) * 2, indexing="ij")
    down, across = down[None], across[None]
    x = (jnp.cos(angle) * across + jnp.sin(angle) * down) / period + warp * first
    y = (jnp.cos(angle) * down - jnp.sin(angle) * across) / period + warp * second
    y = y * draws.log_uniform(0.5, 2.0)
    sharpness = period * draws.log_uniform(0.15, 1.0)  # edges one texel wide, or softer

    duty = draws.uniform(-0.7, 0.7)
    stripes = jnp.tanh(sharpness * (_wave(x) - duty))
    checks = jnp.tanh(sharpness * _wave(x)) * jnp.tanh(sharpness * _wave(y))
    mosaics = _cell_values(x, y)
    size = draws.uniform(0.2, 0.48) * jnp.where(draws.chance(0.5), 1.0, 0.6 + 0.4 * mosaics)
    from_centre = jnp.hypot(x - jnp.floor(x) - 0.5, y - jnp.floor(y) - 0.5)
    dots = jnp.tanh(3.0 * sharpness * (size - from_centre))
    course = jnp.floor(y)
    along = x + 0.5 * jnp.mod(course, 2.0)
    joint = jnp.minimum(_to_line(along), 0.5 * _to_line(y)) - draws.uniform(0.01, 0.05)
    bricks = jnp.where(joint < 0.0, draws.signed(0.5, 1.0), 0.6 * _cell_values(along, y))
    radius = jnp.hypot(across - 128.0 + 60.0 * warp * first, down - 128.0) / 128.0
    gradients = jnp.where(
        draws.chance(0.5),
        _wave((x - warp * first) * period / draws.log_uniform(150.0, 900.0) + draws.unit()),
        _wave(radius * draws.uniform(0.1, 0.6)),
    )

    # In the order of the fields of Textures.
    candidates = [clouds, stripes, checks, dots, bricks, mosaics, gradients]
    kind = draws.category(dataclasses.astuple(kinds))
    chosen = sum(jnp.where(kind == i, candidate, 0.0) for i, candidate in enumerate(candidates))
    mottling = jnp.where(kind == 0, 0.0, draws.choose(0.6, draws.uniform(0.0, 0.4)))
    chosen = chosen * (1.0 - mottling) + mottling * jnp.clip(second / 2.5, -1.0, 1.0)
    return jnp.clip(chosen, -1.0, 1.0)


def outlines(
    draws: Draws, noise_key: Key, count: int, kinds: Outlines
) -> Bool[Array, "count 256 256"]:
    """Draw outlines over the square [-1, 1]^2 of y and x, true inside."""
    if sum(dataclasses.astuple(kinds)) <= 0.0:
        return jnp.zeros((count, SIZE, SIZE), bool)
    draws = draws.with_shape((count, 1, 1))
    axis = jnp.linspace(-1.0, 1.0, SIZE)
    y, x = (
        jnp.broadcast_to(axis[None, :, None], (1, SIZE, SIZE)),
        axis[None, None, :],
    )
    radius = jnp.hypot(x, y)
    rough, other = noise(
        noise_key,
        draws.uniform(1.2, 2.2),
        draws.angle(),
        draws.log_uniform(1.0, 3.0),
        draws.log_uniform(1.0, 6.0),
    )

    square = 0.97 - jnp.maximum(jnp.abs(x), jnp.abs(y))
    plain = jnp.where(draws.chance(0.6), square, 0.97 - radius)

    polygon = square
    for corner in range(6):
        turn = draws.uniform(corner, corner + 1.0) * (np.pi / 3.0)
        polygon = jnp.minimum(
            polygon, draws.uniform(0.35, 0.95) - x * jnp.cos(turn) - y * jnp.sin(turn)
        )
    frame = jnp.minimum(polygon, draws.uniform(0.04, 0.2) - polygon)
    polygon = jnp.where(draws.chance(0.25), frame, polygon)

    blob = 0.7 - radius + draws.uniform(0.05, 0.4) * jnp.clip(rough, -2.0, 2.0)
    blob = jnp.minimum(blob, square)
    holes = jnp.minimum(
        0.15 * (rough + draws.uniform(-0.7, 0.7)),
        jnp.where(draws.chance(0.5), square, 0.9 - radius + 0.1 * other),
    )

    width, lines = draws.log_uniform(0.02, 0.12), draws.uniform(0.6, 4.0)
    upright = width - _to_line(lines * x + draws.unit()) / lines
    level = width * draws.uniform(0.5, 1.5) - _to_line(lines * y + draws.unit()) / lines
    grids = jnp.where(draws.chance(0.4), upright, jnp.maximum(upright, level))
    grids = jnp.minimum(grids, square)

    wires = jnp.full((1, 1, 1), -1.0)
    for _ in range(4):
        turn, bend = draws.angle(), draws.uniform(-0.6, 0.6)
        along = x * jnp.cos(turn) + y * jnp.sin(turn)
        height = y * jnp.cos(turn) - x * jnp.sin(turn) - bend * (along**2 - 0.3)
        wires = jnp.maximum(
            wires, draws.log_uniform(0.012, 0.06) - jnp.abs(height + draws.uniform(-0.5, 0.5))
        )
    wires = jnp.minimum(wires, square)

    # In the order of the fields of Outlines.
    candidates = [plain, polygon, blob, holes, grids, wires, _leaves(draws, count, x, y)]
    kind = draws.category(dataclasses.astuple(kinds))
    inside = [(kind == i) & (candidate > 0.0) for i, candidate in enumerate(candidates)]
    return functools.reduce(jnp.logical_or, inside)


def noise(
    key: Key,
    exponent: Float[Array, "count 1 1"],
    angle: Float[Array, "count 1 1"],
    stretch: Float[Array, "count 1 1"],
    coarsest: Float[Array, "count 1 1"],
) -> tuple[Float[Array, "count 256 256"], Float[Array, "count 256 256"]]:
    """Draw pairs of independent periodic random fields of mean 0 and standard deviation 1.

    The amplitude falls as ``1 / f^exponent`` and is flat below the frequency ``coarsest``. Complex
    white noise is shaped in the frequency domain; real and imaginary part are the two fields.

    Args:
        key: Random key.
        exponent: Exponent of the spectrum of each pair; 1 is that of natural images.
        angle: Direction in which the noise is stretched, in radians.
        stretch: Factor of stretching; 1 means none.
        coarsest: Periods per side of the coarsest structures.

    Returns:
        Two arrays ``[count, SIZE, SIZE]``.
    """
    white = jax.random.uniform(key, (2, len(exponent), SIZE, SIZE)) - 0.5
    frequency = jnp.asarray(np.fft.fftfreq(SIZE, 1.0 / SIZE), jnp.float32)
    down, across = frequency[None, :, None], frequency[None, None, :]
    along = (jnp.cos(angle) * across + jnp.sin(angle) * down) * stretch
    crosswise = jnp.cos(angle) * down - jnp.sin(angle) * across
    squared = along**2 + crosswise**2
    amplitude = (squared + coarsest**2) ** (-0.5 * exponent)
    amplitude = jnp.where(squared > 0.0, amplitude, 0.0)
    field = jnp.fft.ifft2(jax.lax.complex(white[0], white[1]) * amplitude.astype(jnp.complex64))

    def normal(part):
        return part * jax.lax.rsqrt(jnp.mean(part * part, axis=(1, 2), keepdims=True) + 1e-20)

    return normal(field.real), normal(field.imag)


def _leaves(draws: Draws, count: int, x, y, leaves: int = 9) -> Float[Array, "count 256 256"]:
    """Draw leaves along a curved twig; positive inside."""
    twig, draws = draws.with_shape((count, 1, 1)), draws.with_shape((leaves, count, 1, 1))
    turns, starts = draws.angle(), draws.uniform(-0.8, 0.4)
    lengths, widths = draws.uniform(0.35, 0.9), draws.uniform(0.06, 0.2)
    bend, thickness = twig.uniform(-0.5, 0.5), twig.uniform(0.008, 0.03)
    stem = jnp.minimum(thickness - jnp.abs(x - bend * (y**2 - 0.3)), 0.8 - jnp.abs(y))

    def add(level, leaf):
        turn, start, length, width = leaf
        left, top = x - bend * (start**2 - 0.3), y - start
        along = (left * jnp.cos(turn) + top * jnp.sin(turn)) / length
        across_leaf = jnp.abs(top * jnp.cos(turn) - left * jnp.sin(turn))
        blade = width * 4.0 * along * (1.0 - along) - across_leaf
        return jnp.maximum(level, blade), None

    level, _ = jax.lax.scan(add, stem, (turns, starts, lengths, widths))
    edge = 0.99 - jnp.maximum(jnp.abs(x), jnp.abs(y))
    return jnp.minimum(level, edge)


def _wave(value):
    """Return a triangle wave of period 1 between -1 and 1."""
    return 4.0 * jnp.abs(value - jnp.floor(value) - 0.5) - 1.0


def _to_line(value):
    """Return the distance to the nearest whole number."""
    return 0.5 - jnp.abs(value - jnp.floor(value) - 0.5)


def _cell_values(x, y):
    """Return a pseudo-random value in [-1, 1] for each unit cell."""
    mixed = jnp.sin(12.9898 * jnp.floor(x) + 78.233 * jnp.floor(y)) * 437.5453
    return 2.0 * (mixed - jnp.floor(mixed)) - 1.0
