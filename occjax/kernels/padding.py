"""Padding of images by their border pixels, and maps that XLA stores, fast on a CPU.

The reference of :func:`pad_borders` is ``numpy.pad`` with ``mode="edge"``.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from jaxtyping import Array

Images = TypeVar("Images", np.ndarray, Array)


def pad_borders(images: Images, rows: tuple[int, int], columns: tuple[int, int]) -> Images:
    """Replicate the outermost pixels of images.

    Args:
        images: ``[..., h, w]`` NumPy or JAX array; the result is of the same kind.
        rows: Number of rows to add above and below.
        columns: Number of columns to add on the left and on the right.

    Returns:
        ``[..., h + sum(rows), w + sum(columns)]`` images.

    Example:
        >>> pad_borders(np.array([[1.0, 2.0]]), (0, 1), (1, 0)).tolist()
        [[1.0, 1.0, 2.0], [1.0, 1.0, 2.0]]
    """
    # A concatenation of rows, as in jnp.pad, would be fused into all operations that read the
    # result, which repeats the operations before it in each of them. XLA keeps the result of a
    # selection of rows. A selection of columns would take longer than their concatenation.
    if any(rows):
        height = images.shape[-2]
        selected = np.clip(np.arange(-rows[0], height + rows[1]), 0, height - 1)
        images = images[..., selected, :]
    margins = [(0, 0)] * (images.ndim - 1) + [columns]
    return images.__array_namespace__().pad(images, margins, mode="edge")


def materialised(maps: Array) -> Array:
    """Return the same maps ``[..., h, w]``, stored once instead of recomputed by each reader.

    XLA fuses the operations before several readers into each of them and removes
    ``jax.lax.optimization_barrier`` before that. It keeps the result of a selection of rows, even
    of all rows.
    """
    return maps[..., np.arange(maps.shape[-2]), :]
