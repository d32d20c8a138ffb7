"""View attention, and 3-D convolutions from a cost volume to a score for each candidate."""

from __future__ import annotations

import flax.linen as nn
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.models.occcasnet.config import AggregationConfig
from occjax.models.occcasnet.layers import VolumeConv, normalise


class ViewAttention(nn.Module):
    """Weight of each view from the mean of its features over the volume.

    The weights are symmetric: the network predicts those of one octant of the grid, n (n + 1) / 2
    for n = (V + 1) / 2, and mirrors them to all views.

    Attributes:
        views: Number of view rows and view columns, odd.
        hidden: Number of hidden units.
    """

    views: int
    hidden: int

    @nn.compact
    def __call__(self, mean: Float[Array, " channels"]) -> Float[Array, "v v"]:
        """Compute the weights from the mean features.

        Args:
            mean: ``[V * U * C]`` mean of each channel of the volume over candidates and pixels.

        Returns:
            ``[V, V]`` weights in (0, 1).
        """
        side = self.views // 2 + 1
        octant = nn.relu(nn.Dense(self.hidden, name="hidden")(mean.astype(jnp.float32)))
        octant = nn.sigmoid(nn.Dense(side * (side + 1) // 2, name="octant")(octant))
        row, column = jnp.triu_indices(side)
        quadrant = jnp.zeros((side, side)).at[row, column].set(octant).at[column, row].set(octant)
        return jnp.pad(quadrant, (0, self.views - side), mode="reflect")


class Aggregation(nn.Module):
    """Aggregation of a volume ``[D, H, W, C]`` into scores ``[D, H, W]`` by 3x3x3 convolutions.

    Attributes:
        config: Width and number of residual blocks.
        dtype: Type of the computation.
    """

    config: AggregationConfig
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(self, volume: Float[Array, "d h w c"], *, train: bool) -> Float[Array, "d h w"]:
        """Compute the scores; a higher score means a more likely candidate.

        Args:
            volume: ``[d, h, w, c]`` cost volume.
            train: Whether BatchNorm uses batch statistics.

        Returns:
            ``[d, h, w]`` float32 scores.
        """

        def conv(x, name):
            return VolumeConv(self.config.width, dtype=self.dtype, name=name)(x)

        def norm(x, name):
            # On a CPU, XLA can be ten times slower to sum over three axes than over two.
            flat = x.reshape(-1, *x.shape[2:])
            flat = normalise(train=train, dtype=self.dtype, name=f"{name}_norm")(flat)
            return flat.reshape(x.shape)

        def conv_norm(x, name):
            return norm(conv(x, name), name)

        x = nn.relu(conv_norm(volume, "conv_0"))
        x = nn.relu(conv_norm(x, "conv_1"))
        for pair in range(self.config.pairs):
            residual = nn.relu(conv_norm(x, f"pair_{pair}_conv_0"))
            x = x + conv_norm(residual, f"pair_{pair}_conv_1")
        x = nn.relu(conv_norm(x, "conv_2"))
        return VolumeConv(1, dtype=self.dtype, name="score")(x)[..., 0].astype(jnp.float32)
