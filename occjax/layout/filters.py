"""Local means of images, and their reduction in size."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from jaxtyping import Array

Image = TypeVar("Image", np.ndarray, Array)


def box_mean(image: Image, radius: int) -> Image:
    """Return the ``[h, w]`` mean over a square of side ``2 * radius + 1``; borders replicated.

    :func:`occjax.models.proposal.filters.box_filter` is for stacks within a compiled program. This
    function also filters NumPy arrays, without a compilation for each size.

    Args:
        image: ``[h, w]`` NumPy or JAX array; the result is of the same kind.
        radius: Half width of the square, in pixels.
    """
    h, w = image.shape
    side = 2 * radius + 1
    padded = image.__array_namespace__().pad(image, radius, mode="edge")
    rows = padded[:h].copy()
    for start in range(1, side):
        rows += padded[start : start + h]
    mean = rows[:, :w].copy()
    for start in range(1, side):
        mean += rows[:, start : start + w]
    mean /= np.float32(side**2)
    return mean


def high_pass(image: Image, radius: int) -> Image:
    """Subtract the local mean from an ``[h, w]`` image.

    Args:
        image: ``[h, w]`` NumPy or JAX array; the result is of the same kind.
        radius: Half width of the square of the mean, in pixels.
    """
    return image - box_mean(image, radius)


def reduce_image(image: np.ndarray, scale: int) -> np.ndarray:
    """Return means of ``scale`` x ``scale`` blocks; incomplete blocks are left out."""
    h, w = image.shape[0] // scale * scale, image.shape[1] // scale * scale
    # Sums of strided slices: a NumPy mean over two short axes takes five times as long.
    total = np.zeros((h // scale, w // scale), np.float32)
    for row in range(scale):
        total += sum(image[row:h:scale, column:w:scale] for column in range(scale))
    return total / np.float32(scale**2)
