"""Layers shared by the feature network and the aggregations."""

from __future__ import annotations

import functools

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.ops.plain_convolution import plain_convolution

BATCH_AXIS = "batch"
"""Name of the vmapped axis over which BatchNorm synchronises its statistics while training."""


EPSILON = 1e-3
"""Of BatchNorm, as published."""


def normalise(*, train: bool, dtype: DTypeLike, name: str | None = None) -> nn.BatchNorm:
    """BatchNorm as published: epsilon 1e-3, momentum 0.99, synchronised over the batch."""
    return nn.BatchNorm(
        use_running_average=not train,
        momentum=0.99,
        epsilon=EPSILON,
        axis_name=BATCH_AXIS if train else None,
        dtype=dtype,
        name=name,
    )


convolve = functools.partial(nn.Conv, padding="SAME", use_bias=False)
"""Two-dimensional convolution before a BatchNorm: zero padding, no bias."""


_KEEPS_VARIANCE = nn.initializers.he_normal()
"""For layers with a ReLU behind them (He et al., Delving Deep into Rectifiers, ICCV 2015)."""


class ImageConv(nn.Module):
    """3x3 convolution of images ``[N, H, W, C]``, zero padding, with bias.

    Not normalised: a batch on a CPU is a few light fields, and statistics over so few tell the
    layers what those light fields are, which is not there to rely on when there is but one.

    Attributes:
        channels: Number of output channels.
        dtype: Type of the computation; parameters stay float32.
    """

    channels: int
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(self, images: Float[Array, "n h w c"]) -> Float[Array, "n h w k"]:
        """Convolve."""
        shape = (3, 3, images.shape[-1], self.channels)
        kernel = self.param("kernel", _KEEPS_VARIANCE, shape, jnp.float32)
        bias = self.param("bias", nn.initializers.zeros, (self.channels,), jnp.float32)
        images = convolve_images(images.astype(self.dtype), kernel.astype(self.dtype))
        return images + bias.astype(self.dtype)[None, None, None]


class Residual3x3(nn.Module):
    """``x + conv(relu(conv(x)))``, then ReLU; starts with half of the second convolution.

    Attributes:
        dtype: Type of the computation.
    """

    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(self, images: Float[Array, "n h w c"]) -> Float[Array, "n h w c"]:
        """Convolve twice, add."""
        channels = images.shape[-1]
        inner = nn.relu(ImageConv(channels, dtype=self.dtype, name="conv_0")(images))
        return nn.relu(images + 0.5 * ImageConv(channels, dtype=self.dtype, name="conv_1")(inner))


@jax.custom_vjp
def convolve_images(
    images: Float[Array, "n h w c"], kernel: Float[Array, "i j c k"]
) -> Float[Array, "n h w k"]:
    """Convolution with zero padding, whose kernel's gradient is quick on a CPU.

    That gradient is a convolution of the images with the gradient of the result as a kernel as
    large as the image. Taken image by image, with channels for a batch, XLA computes it there two
    and a half times as fast as in one. Has no forward-mode derivative.

    Args:
        images: ``[n, h, w, c]``.
        kernel: ``[i, j, c, k]`` of odd size.

    Returns:
        ``[n, h, w, k]``.
    """
    return plain_convolution(images, kernel)


def _convolve_forward(images: Array, kernel: Array) -> tuple[Array, tuple[Array, Array]]:
    return plain_convolution(images, kernel), (images, kernel)


def _convolve_backward(kept: tuple[Array, Array], gradient: Array) -> tuple[Array, Array]:
    images, kernel = kept
    of_images = jax.linear_transpose(lambda images: plain_convolution(images, kernel), images)
    margins = tuple((size // 2, size // 2) for size in kernel.shape[:2])

    def at_once(images: Array, gradient: Array) -> Array:
        of_kernel = jax.linear_transpose(lambda kernel: plain_convolution(images, kernel), kernel)
        return of_kernel(gradient)[0]

    def one_by_one(images: Array, gradient: Array) -> Array:
        def add_image(total: Array, pair: tuple[Array, Array]):
            image, gradient = pair
            result = jax.lax.conv_general_dilated(
                jnp.moveaxis(image, -1, 0)[..., None],
                gradient[:, :, None],
                (1, 1),
                margins,
                dimension_numbers=("NHWC", "HWIO", "NHWC"),
            )
            return total + jnp.moveaxis(result, 0, 2), None

        return jax.lax.scan(add_image, jnp.zeros_like(kernel), (images, gradient))[0]

    of_kernel = jax.lax.platform_dependent(images, gradient, cpu=one_by_one, default=at_once)
    return of_images(gradient)[0], of_kernel


convolve_images.defvjp(_convolve_forward, _convolve_backward)


def space_to_depth(images: Float[Array, "n h w c"]) -> Float[Array, "n i j k"]:
    """Each 2x2 pixels as one of four times as many channels; height and width must be even.

    Convolutions of few channels at full resolution take as long as wide ones at half of it.

    Example:
        >>> space_to_depth(jnp.arange(4.0).reshape(1, 2, 2, 1)).tolist()
        [[[[0.0, 1.0, 2.0, 3.0]]]]
    """
    n, h, w, c = images.shape
    blocks = images.reshape(n, h // 2, 2, w // 2, 2, c)
    return blocks.transpose(0, 1, 3, 2, 4, 5).reshape(n, h // 2, w // 2, 4 * c)


def depth_to_space(images: Float[Array, "n i j k"]) -> Float[Array, "n h w c"]:
    """The inverse of :func:`space_to_depth`.

    Example:
        >>> images = jnp.arange(24.0).reshape(1, 2, 4, 3)
        >>> bool((depth_to_space(space_to_depth(images)) == images).all())
        True
    """
    n, i, j, k = images.shape
    blocks = images.reshape(n, i, j, 2, 2, k // 4)
    return blocks.transpose(0, 1, 3, 2, 4, 5).reshape(n, 2 * i, 2 * j, k // 4)
