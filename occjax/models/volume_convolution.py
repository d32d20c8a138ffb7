"""3x3x3 convolution of a volume, quick to differentiate on a CPU.

Three 2-D convolutions, one for each plane of the kernel, over slices of the volume are twice as
fast there as XLA's 3-D convolution. While training on a CPU, two more things count; other platforms
are left to XLA.

* The gradient of the kernel is a convolution with a kernel as large as a slice, for which XLA takes
  four times as long as for the layer itself. Here it is a sum of matrix products, slice by slice.
* The layer itself and the gradient of the volume, a convolution as well, have half of the
  multiplications, see :mod:`occjax.ops.minimal_filtering`.
"""

from __future__ import annotations

from functools import partial

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.ops.minimal_filtering import ROWS, convolve_rows, row_kernels, rows_between_zeros
from occjax.ops.plain_convolution import plain_convolution

WIDE = 16
"""Channels from which on minimal filtering is worth combining rows."""


class VolumeConv(nn.Module):
    """3x3x3 convolution of a volume ``[D, H, W, C]``, zero padding, no bias.

    Attributes:
        channels: Number of output channels.
        dtype: Type of the computation; parameters stay float32.
    """

    channels: int
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(self, volume: Float[Array, "d h w c"]) -> Float[Array, "d h w k"]:
        """Convolve."""
        kernel = self.param(
            "kernel",
            nn.initializers.lecun_normal(),
            (3, 3, 3, volume.shape[-1], self.channels),
            jnp.float32,
        )
        return convolve_volume(volume.astype(self.dtype), kernel.astype(self.dtype))


@jax.custom_vjp
def convolve_volume(
    volume: Float[Array, "d h w c"], kernel: Float[Array, "3 3 3 c k"]
) -> Float[Array, "d h w k"]:
    """What :class:`VolumeConv` computes, with a kernel.

    Has no forward-mode derivative. Where it is differentiated on a CPU in float32, the last digits
    of its value are others than where it is not.

    Args:
        volume: ``[d, h, w, c]``.
        kernel: ``[3, 3, 3, c, k]``.

    Returns:
        ``[d, h, w, k]``.
    """
    return _plain(volume, kernel)


def _plain(
    volume: Float[Array, "d h w c"], kernel: Float[Array, "3 3 3 c k"]
) -> Float[Array, "d h w k"]:
    """The same with XLA's derivatives."""

    def plane(slices, depth):
        return plain_convolution(slices, kernel[depth])

    result = plane(volume, 1)
    result = result.at[1:].add(plane(volume[:-1], 0))
    return result.at[:-1].add(plane(volume[1:], 2))


def _forward(volume: Array, kernel: Array) -> tuple[Array, tuple[Array, Array]]:
    return _filtered(volume, kernel), (volume, kernel)


def _backward(kept: tuple[Array, Array], gradient: Array) -> tuple[Array, Array]:
    volume, kernel = kept
    turned = jnp.flip(kernel, (0, 1, 2)).swapaxes(3, 4)

    def at_once(volume: Array, gradient: Array) -> Array:
        return jax.linear_transpose(partial(_plain, volume), kernel)(gradient)[0]

    of_kernel = jax.lax.platform_dependent(volume, gradient, cpu=_slice_by_slice, default=at_once)
    return _filtered(gradient, turned), of_kernel


convolve_volume.defvjp(_forward, _backward)


def _filtered(
    volume: Float[Array, "d h w c"], kernel: Float[Array, "3 3 3 c k"]
) -> Float[Array, "d h w k"]:
    """The convolution, on a CPU with half of the multiplications if there are many."""
    narrow = min(kernel.shape[3:]) < WIDE or volume.shape[1] < ROWS
    if narrow or volume.dtype != jnp.float32:
        return _plain(volume, kernel)

    def in_rows(volume: Array, kernel: Array) -> Array:
        rows = jnp.pad(jnp.moveaxis(volume, 1, 0), ((1, 1), (0, 0), (0, 0), (0, 0)))
        read = rows_between_zeros(rows)
        result = convolve_rows(read, volume.shape[1], row_kernels(kernel), lambda rows, _: rows)
        return jnp.moveaxis(result[1:-1], 0, 1)

    return jax.lax.platform_dependent(volume, kernel, cpu=in_rows, default=_plain)


def _slice_by_slice(
    volume: Float[Array, "d h w c"], gradient: Float[Array, "d h w k"]
) -> Float[Array, "3 3 3 c k"]:
    """Gradient of the kernel from that of the result."""
    (_, h, w, c), k = volume.shape, gradient.shape[-1]
    volume = jnp.pad(volume, ((1, 1), (0, 0), (0, 0), (0, 0)))
    gradient = jnp.pad(gradient, ((0, 0), (1, 1), (1, 1), (0, 0)))
    sums = jnp.float64 if gradient.dtype == jnp.float64 else jnp.float32
    product = partial(jnp.einsum, "ipc,pk->ick", preferred_element_type=sums)

    def add_slice(total: Array, pair: tuple[Array, Array]):
        depth, gradient = pair
        slices = jax.lax.dynamic_slice_in_dim(volume, depth, 3).reshape(3, h * w, c)
        moved = [
            gradient[2 - row : 2 - row + h, 2 - column : 2 - column + w].reshape(h * w, k)
            for row, column in np.ndindex(3, 3)
        ]
        return total + product(slices, jnp.concatenate(moved, 1)), None

    start = jnp.zeros((3, c, 9 * k), sums)
    total, _ = jax.lax.scan(add_slice, start, (jnp.arange(len(gradient)), gradient))
    return total.reshape(3, c, 3, 3, k).transpose(0, 2, 3, 1, 4).astype(volume.dtype)
