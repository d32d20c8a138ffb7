"""What the centre view alone says about where surfaces end: guidance for the aggregations."""

from __future__ import annotations

import flax.linen as nn
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.models.layers import ConvRelu, HalvingConvRelu, halve


class Guide(nn.Module):
    """Features of the centre view at half resolution and below.

    Attributes:
        widths: Channels of each level from a quarter of the resolution on; there is one more, as
            wide as the first, of half the resolution.
        dtype: Type of the computation.
    """

    widths: tuple[int, ...]
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(
        self, centre: Float[Array, "h w"], context: Float[Array, "i j k"]
    ) -> list[Float[Array, "1 _ _ _"]]:
        """Levels of the guide.

        Args:
            centre: ``[h, w]`` grey centre view, multiples of ``2 ** (len(widths) + 1)`` in size.
            context: ``[h / 4, w / 4, k]`` what the first volume knows beside the ranking of its
                candidates: how much the views differ at all.

        Returns:
            Level k is ``[1, h / 2^(k + 1), w / 2^(k + 1), c]``.
        """
        image = (centre - 0.5)[None, :, :, None].astype(self.dtype)
        x = HalvingConvRelu(self.widths[0], dtype=self.dtype, name="image")(image)
        levels = [ConvRelu(self.widths[0], dtype=self.dtype, name="level_0")(x)]
        for level, width in enumerate(self.widths, start=1):
            x = halve(levels[-1])
            if level == 1:
                x = jnp.concatenate([x, context[None].astype(self.dtype)], axis=-1)
            levels.append(ConvRelu(width, dtype=self.dtype, name=f"level_{level}")(x))
        return levels


class Gate(nn.Module):
    """Weight the channels of a volume, alike for all candidates, by what the guide sees.

    Guided cost volume excitation (Bangunharcana et al., Correlate-and-Excite, IROS 2021).

    Attributes:
        dtype: Type of the computation.
    """

    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(
        self, volume: Float[Array, "d h w c"], guide: Float[Array, "1 h w g"]
    ) -> Float[Array, "d h w c"]:
        """Weighted volume."""
        gate = nn.Conv(volume.shape[-1], (1, 1), dtype=self.dtype, name="gate")(guide)
        return volume * nn.sigmoid(gate[0])[None]
