"""The convolution that all others are made of."""

from __future__ import annotations

import jax
from jaxtyping import Array, Float


def plain_convolution(
    images: Float[Array, "n h w c"], kernel: Float[Array, "i j c k"]
) -> Float[Array, "n h w k"]:
    """Two-dimensional convolution with zero padding, by XLA and with XLA's derivatives.

    Args:
        images: ``[n, h, w, c]``.
        kernel: ``[i, j, c, k]`` of odd size.

    Returns:
        ``[n, h, w, k]``.
    """
    layout = ("NHWC", "HWIO", "NHWC")
    return jax.lax.conv_general_dilated(images, kernel, (1, 1), "SAME", dimension_numbers=layout)
