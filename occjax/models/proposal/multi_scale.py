"""Convolutions of the selector and of the residual stage."""

from __future__ import annotations

import flax.linen as nn
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.kernels.convolution import convolve_images
from occjax.models.proposal.resolution import downsample2x, upsample2x

_he_normal = nn.initializers.he_normal()  # for layers before a ReLU (He et al., ICCV 2015)


class ImageConv(nn.Module):
    """3x3 convolution of images ``[N, H, W, C]``, zero padding, with bias, without normalisation.

    A batch on a CPU is a few light fields. With batch statistics, the result of a light field would
    depend on the few others of its batch, which do not exist at inference.

    Attributes:
        channels: Number of output channels.
        dtype: Type of the computation; parameters stay float32.
    """

    channels: int
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(self, images: Float[Array, "n h w c"]) -> Float[Array, "n h w k"]:
        """Apply the convolution."""
        shape = (3, 3, images.shape[-1], self.channels)
        kernel = self.param("kernel", _he_normal, shape, jnp.float32)
        bias = self.param("bias", nn.initializers.zeros, (self.channels,), jnp.float32)
        images = convolve_images(images.astype(self.dtype), kernel.astype(self.dtype))
        return images + bias.astype(self.dtype)[None, None, None]


class Residual3x3(nn.Module):
    """``relu(x + conv(relu(conv(x))) / 2)``.

    Attributes:
        dtype: Type of the computation.
    """

    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(self, images: Float[Array, "n h w c"]) -> Float[Array, "n h w c"]:
        """Apply both convolutions and add."""
        channels = images.shape[-1]
        inner = nn.relu(ImageConv(channels, dtype=self.dtype, name="conv_0")(images))
        return nn.relu(images + 0.5 * ImageConv(channels, dtype=self.dtype, name="conv_1")(inner))


def multi_scale_features(
    images: Float[Array, "n i j c"], widths: tuple[int, ...], dtype: DTypeLike
) -> Float[Array, "n i j k"]:
    """Aggregate a large neighbourhood: downsample, convolve, upsample.

    The layers belong to the module in whose compact method the function is called.

    Args:
        images: ``[n, i, j, c]`` images; i and j must be multiples of ``2 ** (len(widths) - 1)``.
        widths: Channels of each level; each level after the first halves the resolution.
        dtype: Type of the convolutions.

    Returns:
        ``[n, i, j, widths[0]]`` features.
    """

    def normalise(x, name):
        # Over the channels of each pixel. Without it, so many layers in a row grow without bounds.
        # Statistics over pixels or light fields would depend on the rest of the batch.
        return nn.relu(nn.LayerNorm(dtype=dtype, name=f"{name}_norm")(x))

    def block(x, level, name):
        return normalise(ImageConv(widths[level], dtype=dtype, name=name)(x), name)

    x = nn.Dense(widths[0], dtype=dtype, name="context_enter")(images)
    levels = [block(normalise(x, "context_enter"), 0, "level_0")]
    for level in range(1, len(widths)):
        x = block(downsample2x(levels[-1], (1, 2)), level, f"down_{level}_0")
        levels.append(block(x, level, f"down_{level}_1"))
    x = levels[-1]
    for level in reversed(range(len(widths) - 1)):
        below = nn.Dense(widths[level], dtype=dtype, name=f"widen_{level}")(x)
        x = block(levels[level] + upsample2x(below, (1, 2)), level, f"up_{level}")
    return x
