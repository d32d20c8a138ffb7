"""3x3x3 convolution of a volume, quick to differentiate.

XLA's 3-D convolution is slow on either platform, so this one is made of two-dimensional ones.

On a CPU three of them, one for each plane of the kernel, over slices of the volume are twice as
fast. While training, two more things count there:

* The gradient of the kernel is a convolution with a kernel as large as a slice, for which XLA takes
  four times as long as for the layer itself. Here it is a sum of matrix products, see
  :func:`occjax.ops.convolution.kernel_gradient`.
* It, the layer itself and the gradient of the volume, a convolution as well, have half of the
  multiplications, see :mod:`occjax.ops.minimal_filtering`.

Elsewhere all planes of the kernel are one convolution, whose results are then moved and added: the
volume is read once, channels lie where the matrix units want them, and the gradients, which XLA
derives, are convolutions of the whole batch.
"""

from __future__ import annotations

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.ops.convolution import kernel_gradient, plain_convolution, type_of_sums
from occjax.ops.minimal_filtering import (
    ROWS,
    convolve_rows,
    kernel_gradient_of_rows,
    row_kernels,
    rows_between_zeros,
)

WIDE = 16
"""Channels from which on minimal filtering is worth combining rows."""

ALIGNED = 8
"""Multiple of channels that a GPU's matrix units take without copying them."""


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


def convolve_volume(
    volume: Float[Array, "d h w c"], kernel: Float[Array, "3 3 3 c k"]
) -> Float[Array, "d h w k"]:
    """What :class:`VolumeConv` computes, with a kernel.

    On a CPU it has no forward-mode derivative, and where it is differentiated in float32, the last
    digits of its value are others than where it is not.

    Args:
        volume: ``[d, h, w, c]``.
        kernel: ``[3, 3, 3, c, k]``.

    Returns:
        ``[d, h, w, k]``.

    Raises:
        ValueError: If the kernel is not of 3x3x3.
    """
    if kernel.shape[:3] != (3, 3, 3):
        raise ValueError(f"a kernel of {kernel.shape[:3]}; it must be 3x3x3")
    return jax.lax.platform_dependent(volume, kernel, cpu=_on_cpu, default=_at_once)


def _at_once(
    volume: Float[Array, "d h w c"], kernel: Float[Array, "3 3 3 c k"]
) -> Float[Array, "d h w k"]:
    """All planes of the kernel in one convolution; with XLA's derivatives."""
    d, h, w, c = volume.shape
    k = kernel.shape[-1]
    more, wider = -c % ALIGNED, -3 * k % ALIGNED
    volume = jnp.pad(volume, ((0, 0), (0, 0), (0, 0), (0, more)))
    kernel = kernel.transpose(1, 2, 3, 0, 4).reshape(3, 3, c, 3 * k)
    kernel = jnp.pad(kernel, ((0, 0), (0, 0), (0, more), (0, wider)))
    planes = plain_convolution(volume, kernel)[..., : 3 * k].reshape(d, h, w, 3, k)
    planes = jnp.pad(planes, ((1, 1), (0, 0), (0, 0), (0, 0), (0, 0)))
    planes = planes.astype(type_of_sums(planes))
    total = planes[:-2, ..., 0, :] + planes[1:-1, ..., 1, :] + planes[2:, ..., 2, :]
    return total.astype(volume.dtype)


@jax.custom_vjp
def _on_cpu(
    volume: Float[Array, "d h w c"], kernel: Float[Array, "3 3 3 c k"]
) -> Float[Array, "d h w k"]:
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
    of_kernel = _as_products(volume, gradient, filtered=_is_filtered(volume, kernel))
    return _filtered(gradient, turned), of_kernel


_on_cpu.defvjp(_forward, _backward)


def _filtered(
    volume: Float[Array, "d h w c"], kernel: Float[Array, "3 3 3 c k"]
) -> Float[Array, "d h w k"]:
    """The convolution, with half of the multiplications if there are many."""
    if not _is_filtered(volume, kernel):
        return _on_cpu(volume, kernel)
    rows = jnp.pad(jnp.moveaxis(volume, 1, 0), ((1, 1), (0, 0), (0, 0), (0, 0)))
    read = rows_between_zeros(rows)
    result = convolve_rows(read, volume.shape[1], row_kernels(kernel), lambda rows, _: rows)
    return jnp.moveaxis(result[1:-1], 0, 1)


def _is_filtered(volume: Array, kernel: Array) -> bool:
    wide = min(kernel.shape[3:]) >= WIDE and volume.shape[1] >= ROWS and volume.size > 0
    return wide and volume.dtype == jnp.float32


def _as_products(
    volume: Float[Array, "d h w c"], gradient: Float[Array, "d h w k"], *, filtered: bool
) -> Float[Array, "3 3 3 c k"]:
    """Gradient of the kernel from that of the result."""
    if filtered:
        return kernel_gradient_of_rows(jnp.moveaxis(volume, 1, 0), jnp.moveaxis(gradient, 1, 0))
    shape = (3, 3, 3, volume.shape[-1], gradient.shape[-1])
    if not volume.size:
        return jnp.zeros(shape, volume.dtype)
    volume = jnp.pad(volume, ((1, 1), (0, 0), (0, 0), (0, 0)))

    def add_slice(total: Array, pair: tuple[Array, Array]):
        depth, gradient = pair
        slices = jax.lax.dynamic_slice_in_dim(volume, depth, 3)
        return total + jnp.stack([kernel_gradient(each, gradient, (3, 3)) for each in slices]), None

    pairs = jnp.arange(len(gradient)), gradient
    total, _ = jax.lax.scan(add_slice, jnp.zeros(shape, type_of_sums(gradient)), pairs)
    return total.astype(volume.dtype)
