"""Two-dimensional convolution with zero padding, which all others are made of."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache, partial

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float


def plain_convolution(
    images: Float[Array, "n h w c"], kernel: Float[Array, "i j c k"], dilation: int = 1
) -> Float[Array, "n h w k"]:
    """Convolution by XLA and with XLA's derivatives.

    Args:
        images: ``[n, h, w, c]``.
        kernel: ``[i, j, c, k]`` of odd size.
        dilation: Pixels from tap to tap.

    Returns:
        ``[n, h, w, k]``.
    """
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
    """The same, quick to differentiate on a CPU.

    The gradient of the kernel is a convolution with a kernel as large as an image, for which XLA
    takes several times as long there as for the layer itself, see :func:`kernel_gradient`. On a
    CPU it has no forward-mode derivative.

    Args:
        images: ``[n, h, w, c]``.
        kernel: ``[i, j, c, k]`` of odd size.
        dilation: Pixels from tap to tap.

    Returns:
        ``[n, h, w, k]``.

    Raises:
        ValueError: If the kernel is of even size.
    """
    if not all(size % 2 for size in kernel.shape[:2]):
        raise ValueError(f"a kernel of {kernel.shape[:2]} has no centre; its size must be odd")
    return jax.lax.platform_dependent(images, kernel, **_by_platform(dilation))


@lru_cache
def _by_platform(dilation: int) -> dict[str, Callable[[Array, Array], Array]]:
    """The same functions for the same dilation, or JAX would trace each layer anew.

    Elsewhere than on a CPU the derivatives are XLA's own: they are convolutions of the whole batch,
    where those of a custom rule would be taken for one light field at a time.
    """

    def on_cpu(images: Array, kernel: Array) -> Array:
        return _on_cpu(images, kernel, dilation)

    def elsewhere(images: Array, kernel: Array) -> Array:
        return packed_convolution(images, kernel, dilation)

    return {"cpu": on_cpu, "default": elsewhere}


PACKED = 64
"""Channels that a GPU's matrix units work on at once; fewer take as long."""


def packed_convolution(
    images: Float[Array, "n h w c"], kernel: Float[Array, "i j c k"], dilation: int = 1
) -> Float[Array, "n h w k"]:
    """The same with the channels of neighbouring pixels side by side, for matrix units.

    In memory the channels of several pixels of a row follow each other as those of one pixel do, so
    that nothing is moved. What few channels leave idle goes to the zeros of a wider kernel.

    Args:
        images: ``[n, h, w, c]``.
        kernel: ``[i, j, c, k]`` of odd size.
        dilation: Pixels from tap to tap.

    Returns:
        ``[n, h, w, k]``.
    """
    n, h, w, c = images.shape
    rows, columns, _, k = kernel.shape
    if rows == columns == 1:
        return jnp.einsum("nhwc,ck->nhwk", images, kernel[0, 0])
    together = min(PACKED // max(k, 1), PACKED)
    reach = dilation * (columns // 2)
    if together < 2 or reach > together or images.size == 0:
        return plain_convolution(images, kernel, dilation)
    images = jnp.pad(images, ((0, 0), (0, 0), (0, -w % together), (0, 0)))
    blocks = images.shape[2] // together
    # From pixel p of the block before, the same or the next to pixel q of a block, for each tap.
    beside = 1 if reach else 0
    block, p, q = (
        jnp.arange(size, dtype=jnp.int32) for size in (2 * beside + 1, together, together)
    )
    step = together * (block[:, None, None] - beside) + p[None, :, None] - q[None, None, :]
    # Not a matrix product, for which the best algorithm would be sought for each layer.
    wider = jnp.zeros((rows, *step.shape[:2], c, together, k), kernel.dtype)
    for tap in range(columns):
        here = (step == dilation * (tap - columns // 2))[None, :, :, None, :, None]
        wider = jnp.where(here, kernel[:, tap][:, None, None, :, None], wider)
    wider = wider.reshape(rows, 2 * beside + 1, together * c, together * k)
    result = jax.lax.conv_general_dilated(
        images.reshape(n, h, blocks, together * c),
        wider,
        (1, 1),
        "SAME",
        rhs_dilation=(dilation, 1),
        dimension_numbers=("NHWC", "HWIO", "NHWC"),
    )
    return result.reshape(n, h, blocks * together, k)[:, :, :w]


@partial(jax.custom_vjp, nondiff_argnums=(2,))
def _on_cpu(images: Array, kernel: Array, dilation: int) -> Array:
    return plain_convolution(images, kernel, dilation)


def _forward(images: Array, kernel: Array, dilation: int) -> tuple[Array, tuple[Array, Array]]:
    return plain_convolution(images, kernel, dilation), (images, kernel)


def _backward(dilation: int, kept: tuple[Array, Array], gradient: Array) -> tuple[Array, Array]:
    images, kernel = kept
    rows, columns = kernel.shape[:2]
    of_images = jax.linear_transpose(
        lambda images: plain_convolution(images, kernel, dilation), images
    )

    def add_image(total: Array, pair: tuple[Array, Array]):
        return total + kernel_gradient(*pair, (rows, columns), dilation), None

    start = jnp.zeros(kernel.shape, type_of_sums(gradient))
    of_kernel, _ = jax.lax.scan(add_image, start, (images, gradient))
    return of_images(gradient)[0], of_kernel.astype(kernel.dtype)


_on_cpu.defvjp(_forward, _backward)


NARROW = 16
"""Channels of the result up to which all taps of a kernel are worth one matrix product."""


def kernel_gradient(
    image: Float[Array, "h w c"],
    gradient: Float[Array, "h w k"],
    size: tuple[int, int],
    dilation: int = 1,
) -> Float[Array, "i j c k"]:
    """Gradient of a kernel from that of the convolution of one image, as matrix products.

    Each tap's is the product of the image with the gradient, moved by as much: copied for all taps
    of a row or, if it is narrow, for all there are.

    Args:
        image: ``[h, w, c]``.
        gradient: ``[h, w, k]`` of a function of the convolution.
        size: Rows and columns of the kernel, odd.
        dilation: Pixels from tap to tap.

    Returns:
        ``[i, j, c, k]``, summed in single precision or better.
    """
    (h, w, c), k = image.shape, gradient.shape[-1]
    rows, columns = size
    above, left = (dilation * (taps // 2) for taps in size)
    product = partial(jnp.einsum, "pc,pk->ck", preferred_element_type=type_of_sums(gradient))
    if k <= NARROW:
        moved = jnp.concatenate(list(_moved(gradient, above, left, dilation)), -1)
        result = product(image.reshape(h * w, c), moved.reshape(h * w, rows * columns * k))
        return result.reshape(c, rows, columns, k).transpose(1, 2, 0, 3)
    image = jnp.pad(image, ((above, above), (0, 0), (0, 0))).reshape((h + 2 * above) * w, c)
    moved = jnp.concatenate(list(_moved(gradient, 0, left, dilation)), -1)
    moved = moved.reshape(h * w, columns * k)
    starts = (dilation * row * w for row in range(rows))
    results = jnp.stack([product(image[start : start + h * w], moved) for start in starts])
    return results.reshape(rows, c, columns, k).swapaxes(1, 2)


def type_of_sums(array: Array) -> DTypeLike:
    """Single precision, or double for what is double."""
    return jnp.float64 if array.dtype == jnp.float64 else jnp.float32


def _moved(gradient: Array, above: int, left: int, dilation: int) -> Iterator[Array]:
    """The gradient as far down and to the right as each tap is up and to the left, tap by tap."""
    h, w = gradient.shape[:2]
    padded = jnp.pad(gradient, ((above, above), (left, left), (0, 0)))
    for row in range(2 * above, -1, -dilation):
        for column in range(2 * left, -1, -dilation):
            yield padded[row : row + h, column : column + w]
