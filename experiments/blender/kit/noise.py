"""Smooth three-dimensional noise, which displaces surfaces."""

from __future__ import annotations

import numpy as np

TABLE = 256
"""Number of random lattice values; the noise repeats after this many lattice cells."""


def fractal_noise(
    points: np.ndarray, rng: np.random.Generator, octaves: int = 4, gain: float = 0.5
) -> np.ndarray:
    """Return the sum of octaves of value noise, each with half the previous wavelength.

    Args:
        points: ``[..., 3]`` positions, in wavelengths of the first octave.
        rng: Random generator of the lattice values.
        octaves: Number of octaves.
        gain: Amplitude of an octave relative to the previous one.

    Returns:
        ``[...]`` values in [-1, 1] with a mean of about zero.
    """
    amplitudes = gain ** np.arange(octaves)
    total = sum(
        amplitude * value_noise(points * 2.0**octave + rng.uniform(0.0, TABLE, 3), rng)
        for octave, amplitude in enumerate(amplitudes)
    )
    return np.asarray(total / amplitudes.sum())


def value_noise(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return noise with random values at the integer lattice and smooth interpolation.

    Args:
        points: ``[..., 3]`` positions.
        rng: Random generator of the lattice values.

    Returns:
        ``[...]`` values in [-1, 1].
    """
    values = rng.uniform(-1.0, 1.0, TABLE)
    order = rng.permutation(TABLE)
    cell = np.floor(points).astype(np.int64)
    fraction = points - cell
    # The quintic has zero first and second derivatives at the lattice, which avoids creases.
    blend = fraction**3 * (fraction * (fraction * 6.0 - 15.0) + 10.0)
    total = np.zeros(points.shape[:-1])
    for corner in np.ndindex(2, 2, 2):
        index = np.zeros(points.shape[:-1], np.int64)
        for axis in range(3):
            index = order[(index + cell[..., axis] + corner[axis]) % TABLE]
        weight = np.prod(np.where(corner, blend, 1.0 - blend), axis=-1)
        total += weight * values[index]
    return total
