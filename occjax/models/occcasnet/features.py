"""The feature network: residual blocks and spatial pyramid pooling, shared by all views."""

from __future__ import annotations

import flax.linen as nn
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.models.occcasnet.config import FeatureConfig
from occjax.models.occcasnet.layers import convolve, normalise


class ResidualBlock(nn.Module):
    """Residual block: conv3x3-BN-ReLU-conv3x3-BN plus the input, no ReLU after the sum.

    Attributes:
        channels: Number of output channels.
        dilation: Dilation of both convolutions.
        projected: Whether the input passes a 1x1 convolution and BN before it is added.
        dtype: Type of the computation.
    """

    channels: int
    dilation: int = 1
    projected: bool = False
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(self, x: Float[Array, "n h w c"], *, train: bool) -> Float[Array, "n h w k"]:
        """Apply the block."""
        shortcut = x
        if self.projected:
            shortcut = convolve(self.channels, (1, 1), dtype=self.dtype, name="shortcut")(x)
            shortcut = normalise(train=train, dtype=self.dtype, name="shortcut_norm")(shortcut)
        for index in range(2):
            x = convolve(
                self.channels,
                (3, 3),
                kernel_dilation=self.dilation,
                dtype=self.dtype,
                name=f"conv_{index}",
            )(x)
            x = normalise(train=train, dtype=self.dtype, name=f"norm_{index}")(x)
            if index == 0:
                x = nn.relu(x)
        return x + shortcut


class FeatureNetwork(nn.Module):
    """Feature maps of grey images, at the same size.

    Attributes:
        config: Widths and depths of the layers.
        dtype: Type of the computation.
    """

    config: FeatureConfig
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(self, images: Float[Array, "n h w 1"], *, train: bool) -> Float[Array, "n h w c"]:
        """Compute the features of n images.

        Args:
            images: ``[n, h, w, 1]`` grey images in [0, 1].
            train: Whether BatchNorm uses the statistics of the images and of the vmapped batch,
                instead of the running averages.

        Returns:
            ``[n, h, w, channels]`` features.
        """
        config = self.config
        h, w = images.shape[1:3]

        def conv_norm_relu(x, channels, size, name):
            x = convolve(channels, (size, size), dtype=self.dtype, name=name)(x)
            return nn.relu(normalise(train=train, dtype=self.dtype, name=f"{name}_norm")(x))

        x = conv_norm_relu(images.astype(self.dtype), config.stem, 3, "stem_0")
        x = conv_norm_relu(x, config.stem, 3, "stem_1")
        groups = []
        for group, (width, blocks, dilation) in enumerate(
            zip(config.widths, config.blocks, config.dilations, strict=True)
        ):
            for block in range(blocks):
                x = ResidualBlock(
                    width,
                    dilation,
                    # As published: the first block of every group but the first has a shortcut
                    # convolution, even if the width does not change.
                    projected=block == 0 and group > 0,
                    dtype=self.dtype,
                    name=f"group_{group}_block_{block}",
                )(x, train=train)
            groups.append(x)

        pyramid = []
        for size in config.pooled:
            branch = nn.avg_pool(
                x, (size, size), (size, size), padding="SAME", count_include_pad=False
            )
            branch = conv_norm_relu(branch, config.pooled_width, 1, f"pooled_{size}")
            pyramid.append(upsample(branch, h, w))
        x = jnp.concatenate([groups[1], groups[-1], *reversed(pyramid)], axis=-1)
        x = conv_norm_relu(x, config.fused, 3, "fused")
        return convolve(config.channels, (1, 1), dtype=self.dtype, name="output")(x)


def upsample(images: Float[Array, "n h w c"], height: int, width: int) -> Float[Array, "n H W c"]:
    """Upsample bilinearly with aligned corners: the corner pixels keep their values.

    Args:
        images: ``[n, h, w, c]`` images.
        height: Height H of the result, in pixels.
        width: Width W of the result, in pixels.

    Returns:
        ``[n, H, W, c]`` images.

    Example:
        >>> upsample(jnp.array([0.0, 1.0])[None, None, :, None], 1, 3)[0, 0, :, 0].tolist()
        [0.0, 0.5, 1.0]
    """
    rows = _interpolation(images.shape[1], height).astype(images.dtype)
    columns = _interpolation(images.shape[2], width).astype(images.dtype)
    return jnp.einsum("Hh,nhwc,Ww->nHWc", rows, images, columns)


def _interpolation(source: int, target: int) -> Float[Array, "target source"]:
    """Return the matrix of linear interpolation; each row has at most two non-zero weights."""
    position = jnp.linspace(0.0, source - 1.0, target)
    taps = jnp.arange(source, dtype=position.dtype)
    return jnp.maximum(0.0, 1.0 - jnp.abs(position[:, None] - taps[None, :]))
