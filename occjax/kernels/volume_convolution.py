"""3x3x3 convolution of a volume ``[d, h, w, c]`` with zero padding and fast gradients.

XLA's 3-D convolution is slow on CPU and GPU; it is the reference of :func:`convolve_volume`.

* On a CPU, three two-dimensional convolutions, one per plane of the kernel, are twice as fast. In
  training, the convolution and both gradients need half of the multiplications
  (:mod:`occjax.kernels.minimal_filtering`), and the gradient of the kernel is a sum of matrix
  products (:func:`occjax.kernels.convolution.kernel_gradient`), four times as fast as XLA's.
* On other platforms, one convolution computes the results of all planes of the kernel, which are
  then shifted and added. The volume is read once, channels are aligned for matrix units, and XLA
  derives gradients that are convolutions of the whole batch.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.kernels.convolution import kernel_gradient, plain_convolution
from occjax.kernels.minimal_filtering import (
    OUTPUT_ROWS,
    convolve_rows,
    kernel_gradient_of_rows,
    rows_between_zeros,
)
from occjax.kernels.reductions import accumulation_dtype

MIN_FILTERED_CHANNELS = 16
"""Smallest number of channels for which minimal filtering is faster than a direct convolution."""


def convolve_volume(
    volume: Float[Array, "d h w c"], kernel: Float[Array, "3 3 3 c k"]
) -> Float[Array, "d h w k"]:
    """Convolve a volume.

    On a CPU the function has no forward-mode derivative, and its float32 value differs in the last
    digits between evaluation and differentiation.

    Args:
        volume: ``[d, h, w, c]`` volume.
        kernel: ``[3, 3, 3, c, k]`` kernel.

    Returns:
        ``[d, h, w, k]``.

    Raises:
        ValueError: If the kernel is not 3x3x3.
    """
    if kernel.shape[:3] != (3, 3, 3):
        raise ValueError(f"kernel size is {kernel.shape[:3]}; it must be 3x3x3")
    return jax.lax.platform_dependent(volume, kernel, cpu=_on_cpu, default=_at_once)


def _at_once(
    volume: Float[Array, "d h w c"], kernel: Float[Array, "3 3 3 c k"]
) -> Float[Array, "d h w k"]:
    """Convolve with all planes of the kernel in one convolution; with XLA's derivatives."""
    d, h, w, c = volume.shape
    k = kernel.shape[-1]
    # A GPU's matrix units process multiples of 8 channels without a copy.
    input_padding, result_padding = -c % 8, -3 * k % 8
    volume = jnp.pad(volume, ((0, 0), (0, 0), (0, 0), (0, input_padding)))
    kernel = kernel.transpose(1, 2, 3, 0, 4).reshape(3, 3, c, 3 * k)
    kernel = jnp.pad(kernel, ((0, 0), (0, 0), (0, input_padding), (0, result_padding)))
    planes = plain_convolution(volume, kernel)[..., : 3 * k].reshape(d, h, w, 3, k)
    planes = jnp.pad(planes, ((1, 1), (0, 0), (0, 0), (0, 0), (0, 0)))
    planes = planes.astype(accumulation_dtype(planes))
    total = planes[:-2, ..., 0, :] + planes[1:-1, ..., 1, :] + planes[2:, ..., 2, :]
    return total.astype(volume.dtype)


@jax.custom_vjp
def _on_cpu(
    volume: Float[Array, "d h w c"], kernel: Float[Array, "3 3 3 c k"]
) -> Float[Array, "d h w k"]:
    """Convolve plane by plane of the kernel."""
    result = plain_convolution(volume, kernel[1])
    result = result.at[1:].add(plain_convolution(volume[:-1], kernel[0]))
    return result.at[:-1].add(plain_convolution(volume[1:], kernel[2]))


def _forward(volume: Array, kernel: Array) -> tuple[Array, tuple[Array, Array]]:
    return _filter(volume, kernel), (volume, kernel)


def _backward(saved: tuple[Array, Array], gradient: Array) -> tuple[Array, Array]:
    volume, kernel = saved
    flipped = jnp.flip(kernel, (0, 1, 2)).swapaxes(3, 4)
    if _is_filtered(volume, kernel):
        rows, row_gradient = (jnp.moveaxis(each, 1, 0) for each in (volume, gradient))
        return _filter(gradient, flipped), kernel_gradient_of_rows(rows, row_gradient)
    return _filter(gradient, flipped), _gradient_by_slices(volume, gradient)


_on_cpu.defvjp(_forward, _backward)


def _filter(
    volume: Float[Array, "d h w c"], kernel: Float[Array, "3 3 3 c k"]
) -> Float[Array, "d h w k"]:
    """Convolve by minimal filtering if there are enough channels and rows."""
    if not _is_filtered(volume, kernel):
        return _on_cpu(volume, kernel)
    rows = jnp.pad(jnp.moveaxis(volume, 1, 0), ((1, 1), (0, 0), (0, 0), (0, 0)))
    result = convolve_rows(rows_between_zeros(rows), len(rows) - 2, kernel, lambda rows, _: rows)
    return jnp.moveaxis(result[1:-1], 0, 1)


def _is_filtered(volume: Array, kernel: Array) -> bool:
    enough = min(kernel.shape[3:]) >= MIN_FILTERED_CHANNELS and volume.shape[1] >= OUTPUT_ROWS
    return enough and volume.size > 0 and volume.dtype == jnp.float32


def _gradient_by_slices(
    volume: Float[Array, "d h w c"], gradient: Float[Array, "d h w k"]
) -> Float[Array, "3 3 3 c k"]:
    """Return the gradient of the kernel as a sum over the slices of the volume."""
    shape = (3, 3, 3, volume.shape[-1], gradient.shape[-1])
    if not volume.size:
        return jnp.zeros(shape, volume.dtype)
    volume = jnp.pad(volume, ((1, 1), (0, 0), (0, 0), (0, 0)))

    def add_slice(total: Array, pair: tuple[Array, Array]):
        index, slice_gradient = pair
        slices = jax.lax.dynamic_slice_in_dim(volume, index, 3)
        terms = [kernel_gradient(each, slice_gradient, (3, 3)) for each in slices]
        return total + jnp.stack(terms), None

    pairs = jnp.arange(len(gradient)), gradient
    total, _ = jax.lax.scan(add_slice, jnp.zeros(shape, accumulation_dtype(gradient)), pairs)
    return total.astype(volume.dtype)
