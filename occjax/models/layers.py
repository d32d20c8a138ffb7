"""Layers shared by the feature network and the aggregations."""

from __future__ import annotations

import functools

import flax.linen as nn
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.ops.convolution import convolve_images

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


def _quick(images, kernel, strides, padding, *, rhs_dilation, **ways):
    """What ``nn.Conv`` calls in place of ``jax.lax.conv_general_dilated``, by the same names."""
    return convolve_images(images, kernel, rhs_dilation[0])


convolve = functools.partial(nn.Conv, padding="SAME", use_bias=False, conv_general_dilated=_quick)
"""Two-dimensional convolution before a BatchNorm: zero padding, no bias, no strides."""


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
