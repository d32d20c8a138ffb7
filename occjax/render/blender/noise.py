"""Smooth noise in space, to displace surfaces and vary shapes."""

from __future__ import annotations

import numpy as np

TABLE = 256
"""Entries of the table of random values; the noise repeats after as many lattice cells."""


def fractal_noise(
    points: np.ndarray, rng: np.random.Generator, octaves: int = 4, gain: float = 0.5
) -> np.ndarray:
    """Sum of octaves of value noise, each of half the wavelength of the last.

    Args:
        points: ``[..., 3]`` positions, in wavelengths of the first octave.
        rng: Source of the lattice values.
        octaves: How many are added.
        gain: Amplitude of an octave relative to the last.

    Returns:
        ``[...]`` values of about zero mean, within ``[-1, 1]``.
    """
    amplitudes = gain ** np.arange(octaves)
    total = sum(
        amplitude * value_noise(points * 2.0**octave + rng.uniform(0.0, TABLE, 3), rng)
        for octave, amplitude in enumerate(amplitudes)
    )
    return np.asarray(total / amplitudes.sum())


def value_noise(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Random values at the lattice of whole numbers, blended smoothly in between.

    Args:
        points: ``[..., 3]`` positions.
        rng: Source of the lattice values.

    Returns:
        ``[...]`` values within ``[-1, 1]``.
    """
    values = rng.uniform(-1.0, 1.0, TABLE)
    order = rng.permutation(TABLE)
    cell = np.floor(points).astype(np.int64)
    fraction = points - cell
    # The quintic has no first and second derivative at the lattice, so no crease shows in shading.
    blend = fraction**3 * (fraction * (fraction * 6.0 - 15.0) + 10.0)
    total = np.zeros(points.shape[:-1])
    for corner in np.ndindex(2, 2, 2):
        index = np.zeros(points.shape[:-1], np.int64)
        for axis in range(3):
            index = order[(index + cell[..., axis] + corner[axis]) % TABLE]
        weight = np.prod(np.where(corner, blend, 1.0 - blend), axis=-1)
        total += weight * values[index]
    return total
