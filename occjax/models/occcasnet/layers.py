"""Layers shared by the feature network and the aggregation."""

from __future__ import annotations

import functools

import flax.linen as nn
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.kernels.convolution import convolve_images
from occjax.kernels.volume_convolution import convolve_volume

BATCH_AXIS = "batch"
"""Name of the vmapped axis over which BatchNorm synchronises its statistics in training."""

BATCH_NORM_EPSILON = 1e-3
"""Epsilon of BatchNorm, as published."""


def normalise(*, train: bool, dtype: DTypeLike, name: str | None = None) -> nn.BatchNorm:
    """Return BatchNorm as published: epsilon 1e-3, momentum 0.99, synchronised over the batch."""
    return nn.BatchNorm(
        use_running_average=not train,
        momentum=0.99,
        epsilon=BATCH_NORM_EPSILON,
        axis_name=BATCH_AXIS if train else None,
        dtype=dtype,
        name=name,
    )


def _convolve(images, kernel, strides, padding, *, rhs_dilation, **options):
    """Replace ``jax.lax.conv_general_dilated`` in ``nn.Conv``: the gradients are faster."""
    return convolve_images(images, kernel, rhs_dilation[0])


convolve = functools.partial(
    nn.Conv, padding="SAME", use_bias=False, conv_general_dilated=_convolve
)
"""2-D convolution before BatchNorm: zero padding, no bias, stride 1."""


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
        """Apply the convolution."""
        kernel = self.param(
            "kernel",
            nn.initializers.lecun_normal(),
            (3, 3, 3, volume.shape[-1], self.channels),
            jnp.float32,
        )
        return convolve_volume(volume.astype(self.dtype), kernel.astype(self.dtype))
