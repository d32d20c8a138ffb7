"""Aggregation of volumes of sectors over large regions: down to coarse levels and back."""

from __future__ import annotations

import flax.linen as nn
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.models.config import Hourglass, Planar
from occjax.models.guide import Gate
from occjax.models.layers import (
    ConvRelu,
    SeparableVolumeConvRelu,
    VolumeConv,
    convolve,
    double,
    halve,
)


class HourglassAggregation(nn.Module):
    """3-D convolutions from ``[D, H, W, C]`` to a score ``[D, H, W]``, over several levels.

    Untextured regions take their disparity from textured ones far away, up to the edges that the
    guide shows: at the coarsest of four levels a 3x3 kernel spans 96 pixels of the image.

    Attributes:
        config: Widths and depths.
        dtype: Type of the computation.
    """

    config: Hourglass
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(
        self,
        volume: Float[Array, "d h w c"],
        guide: list[Float[Array, "1 _ _ _"]],
    ) -> Float[Array, "d h w"]:
        """Scores; the higher, the likelier the candidate."""
        widths = self.config.widths

        def block(x, level, name):
            layer = SeparableVolumeConvRelu(widths[level], dtype=self.dtype, name=name)
            return layer(x)

        x = block(volume.astype(self.dtype), 0, "enter")
        levels = [Gate(dtype=self.dtype, name="gate_0")(x, guide[0])]
        for level in range(1, len(widths)):
            x = halve(levels[-1])
            for index in range(self.config.convolutions):
                x = block(x, level, f"down_{level}_{index}")
            levels.append(Gate(dtype=self.dtype, name=f"gate_{level}")(x, guide[level]))
        x = levels[-1]
        for level in reversed(range(len(widths) - 1)):
            below = convolve(widths[level], (1, 1), dtype=self.dtype, name=f"widen_{level}")(x)
            x = block(levels[level] + double(below), level, f"up_{level}")
        # Zero at first: the scores added to these are where training starts from.
        score = VolumeConv(1, self.dtype, nn.initializers.zeros, name="score")
        return score(x)[..., 0].astype(jnp.float32)


class PlanarAggregation(nn.Module):
    """2-D convolutions from an image ``[H, W, C]`` to features of its size, over several levels.

    Attributes:
        config: Widths and depths.
        dtype: Type of the computation.
    """

    config: Planar
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(
        self, image: Float[Array, "h w c"], guide: list[Float[Array, "1 _ _ _"]]
    ) -> Float[Array, "1 h w k"]:
        """Features ``[1, h, w, widths[0]]``."""
        widths = self.config.widths

        def block(x, level, name, size=3):
            return ConvRelu(widths[level], size, dtype=self.dtype, name=name)(x)

        x = block(image[None].astype(self.dtype), 0, "enter", size=1)
        levels = [block(x, 0, "level_0")]
        for level in range(1, len(widths)):
            x = halve(levels[-1])
            if level <= len(guide):
                x = jnp.concatenate([x, guide[level - 1]], axis=-1)
            for index in range(self.config.convolutions):
                x = block(x, level, f"down_{level}_{index}")
            levels.append(x)
        for level in reversed(range(len(widths) - 1)):
            below = convolve(widths[level], (1, 1), dtype=self.dtype, name=f"widen_{level}")(x)
            x = block(levels[level] + double(below), level, f"up_{level}")
        return x
