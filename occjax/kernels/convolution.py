"""Two-dimensional convolution with zero padding and gradients that are fast on CPU and GPU.

:func:`plain_convolution` is the reference of :func:`packed_convolution` and
:func:`convolve_images`; its gradient by XLA is the reference of :func:`kernel_gradient`. Arrays are
``[n, h, w, c]`` images, ``[i, j, c, k]`` kernels of odd size i x j, and ``[n, h, w, k]`` results;
``dilation`` is the distance between kernel taps, in pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache, partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.kernels.reductions import accumulation_dtype

PACKED_CHANNELS = 64
"""Channels that a GPU's matrix units process at once; fewer channels take as long."""

MAX_NARROW_CHANNELS = 16
"""Largest number of result channels for which one matrix product computes all kernel taps."""


def plain_convolution(
    images: Float[Array, "n h w c"], kernel: Float[Array, "i j c k"], dilation: int = 1
) -> Float[Array, "n h w k"]:
    """Convolve with XLA's convolution and derivatives."""
    return jax.lax.conv_general_dilated(
        images,
        kernel,
        (1, 1),
        "SAME",
        rhs_dilation=(dilation, dilation),
        dimension_numbers=("NHWC", "HWIO", "NHWC"),
    )


def convolve_images(
    images: Float[Array, "n h w c"], kernel: Float[Array, "i j c k"], dilation: int = 1
) -> Float[Array, "n h w k"]:
    """Convolve, with a fast gradient on a CPU and packed channels elsewhere.

    For the gradient of the kernel XLA uses a convolution with a kernel of the size of an image. On
    a CPU that takes several times as long as the layer itself, so :func:`kernel_gradient` replaces
    it there. On a CPU the function has no forward-mode derivative.

    Raises:
        ValueError: If the kernel has an even size.
    """
    if not all(size % 2 for size in kernel.shape[:2]):
        raise ValueError(f"kernel size is {kernel.shape[:2]}; it must be odd in both directions")
    return jax.lax.platform_dependent(images, kernel, **_platform_branches(dilation))


@lru_cache
def _platform_branches(dilation: int) -> dict[str, Callable[[Array, Array], Array]]:
    """Return one function per platform, cached: JAX would trace new functions for each layer.

    XLA's own derivatives remain on other platforms. They are convolutions of the whole batch,
    whereas a vmapped custom rule treats one light field at a time.
    """
    return {
        "cpu": lambda images, kernel: _cpu_convolution(images, kernel, dilation),
        "default": lambda images, kernel: packed_convolution(images, kernel, dilation),
    }


def packed_convolution(
    images: Float[Array, "n h w c"], kernel: Float[Array, "i j c k"], dilation: int = 1
) -> Float[Array, "n h w k"]:
    """Convolve with the channels of neighbouring pixels packed together, for matrix units.

    The channels of several pixels of a row follow each other in memory, so packing moves no data.
    The kernel becomes wider and mostly zero; its zeros occupy the matrix units that few channels
    would leave idle.
    """
    n, h, w, c = images.shape
    rows, columns, _, k = kernel.shape
    if rows == columns == 1:
        return jnp.einsum("nhwc,ck->nhwk", images, kernel[0, 0])
    packed = PACKED_CHANNELS // max(k, 1)  # pixels per block
    radius = dilation * (columns // 2)
    if packed < 2 or radius > packed or images.size == 0:
        return plain_convolution(images, kernel, dilation)
    images = jnp.pad(images, ((0, 0), (0, 0), (0, -w % packed), (0, 0)))
    blocks = images.shape[2] // packed
    # A tap leads from pixel p of the previous, the same or the next block to pixel q of a block.
    reach = 1 if radius else 0
    block, p, q = (jnp.arange(size, dtype=jnp.int32) for size in (2 * reach + 1, packed, packed))
    step = packed * (block[:, None, None] - reach) + p[None, :, None] - q[None, None, :]
    # Selection instead of a matrix product: XLA would tune a matrix product for each layer.
    wide = jnp.zeros((rows, *step.shape[:2], c, packed, k), kernel.dtype)
    for tap in range(columns):
        selected = (step == dilation * (tap - columns // 2))[None, :, :, None, :, None]
        wide = jnp.where(selected, kernel[:, tap][:, None, None, :, None], wide)
    wide = wide.reshape(rows, 2 * reach + 1, packed * c, packed * k)
    result = jax.lax.conv_general_dilated(
        images.reshape(n, h, blocks, packed * c),
        wide,
        (1, 1),
        "SAME",
        rhs_dilation=(dilation, 1),
        dimension_numbers=("NHWC", "HWIO", "NHWC"),
    )
    return result.reshape(n, h, blocks * packed, k)[:, :, :w]


@partial(jax.custom_vjp, nondiff_argnums=(2,))
def _cpu_convolution(images: Array, kernel: Array, dilation: int) -> Array:
    return plain_convolution(images, kernel, dilation)


def _forward(images: Array, kernel: Array, dilation: int) -> tuple[Array, tuple[Array, Array]]:
    return plain_convolution(images, kernel, dilation), (images, kernel)


def _backward(dilation: int, saved: tuple[Array, Array], gradient: Array) -> tuple[Array, Array]:
    images, kernel = saved
    rows, columns = kernel.shape[:2]
    # XLA would merge the transposition into the convolution, which then takes ten times as long.
    transposed = jax.lax.optimization_barrier(kernel[::-1, ::-1].swapaxes(2, 3))

    def add_image(total: Array, pair: tuple[Array, Array]):
        return total + kernel_gradient(*pair, (rows, columns), dilation), None

    zero = jnp.zeros(kernel.shape, accumulation_dtype(gradient))
    total, _ = jax.lax.scan(add_image, zero, (images, gradient))
    return plain_convolution(gradient, transposed, dilation), total.astype(kernel.dtype)


_cpu_convolution.defvjp(_forward, _backward)


def kernel_gradient(
    image: Float[Array, "h w c"],
    gradient: Float[Array, "h w k"],
    size: tuple[int, int],
    dilation: int = 1,
) -> Float[Array, "i j c k"]:
    """Return the gradient with respect to the kernel of the convolution of one image.

    For each tap it is the matrix product of the image with the shifted ``gradient``. Shifted copies
    of ``gradient`` are made for all taps of a row or, if it has few channels, of the kernel.

    Args:
        image: ``[h, w, c]`` image.
        gradient: ``[h, w, k]`` gradient with respect to the result of the convolution.
        size: Rows and columns of the kernel, odd.
        dilation: Distance between taps, in pixels.

    Returns:
        ``[i, j, c, k]`` gradient, summed in single precision or better.
    """
    (h, w, c), k = image.shape, gradient.shape[-1]
    rows, columns = size
    above, left = (dilation * (taps // 2) for taps in size)
    product = partial(jnp.einsum, "pc,pk->ck", preferred_element_type=accumulation_dtype(gradient))
    if k <= MAX_NARROW_CHANNELS:
        shifted = jnp.concatenate(list(_shifted(gradient, above, left, dilation)), -1)
        result = product(image.reshape(h * w, c), shifted.reshape(h * w, rows * columns * k))
        return result.reshape(c, rows, columns, k).transpose(1, 2, 0, 3)
    image = jnp.pad(image, ((above, above), (0, 0), (0, 0))).reshape((h + 2 * above) * w, c)
    shifted = jnp.concatenate(list(_shifted(gradient, 0, left, dilation)), -1)
    shifted = shifted.reshape(h * w, columns * k)
    starts = (dilation * row * w for row in range(rows))
    results = jnp.stack([product(image[start : start + h * w], shifted) for start in starts])
    return results.reshape(rows, c, columns, k).swapaxes(1, 2)


def _shifted(gradient: Array, above: int, left: int, dilation: int) -> Iterator[Array]:
    """Yield the gradient for each tap, shifted against the tap's own displacement."""
    h, w = gradient.shape[:2]
    padded = jnp.pad(gradient, ((above, above), (left, left), (0, 0)))
    for row in range(2 * above, -1, -dilation):
        for column in range(2 * left, -1, -dilation):
            yield padded[row : row + h, column : column + w]
