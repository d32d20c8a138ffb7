"""The last step: sub-pixel disparity from the Gauss-Newton steps of the aperture's sectors."""

from __future__ import annotations

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.models.config import RefinementConfig
from occjax.models.layers import ConvNorm
from occjax.models.upsampling import neighbours
from occjax.ops.sectors import SECTORS, SectorSteps

LEAST_INFORMATION = 1e-6
"""That of a gradient of 0.1 %: a pixel with less has no step of its own."""


class SectorRefinement(nn.Module):
    """Choose among the steps that the sectors propose, and smooth what is uncertain.

    The network weighs the sectors (an occluded one counts nothing) and decides how far to trust
    the step at all, ``sum w_s push_s / (sum w_s information_s + lambda)``; then each pixel becomes
    a mean of its 3x3 neighbours with learned weights, plus a small learned correction.

    Attributes:
        config: Its settings.
        dtype: Type of the convolutions.
    """

    config: RefinementConfig
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(
        self,
        disparity: Float[Array, "h w"],
        steps: SectorSteps,
        features: Float[Array, "1 h w c"],
        *,
        train: bool,
    ) -> Float[Array, "h w"]:
        """Refined disparity.

        Args:
            disparity: ``[h, w]``, right to a fraction of a pixel.
            steps: Of all sectors at that disparity.
            features: ``[1, h, w, c]`` of the stage before.
            train: Normalise by batch statistics.

        Returns:
            ``[h, w]``.
        """
        largest = self.config.largest_step

        def step(push, information):
            return jnp.clip(push / (information + LEAST_INFORMATION), -largest, largest)

        # Brought to values of about one: steps by their bound, sums by their logarithm.
        known = jnp.concatenate(
            [
                step(steps.push, steps.information) / largest,
                step(steps.push.sum(0), steps.information.sum(0))[None] / largest,
                0.3 * jnp.log(steps.information + LEAST_INFORMATION),
                0.3 * jnp.log(steps.squares + 1e-7),
            ]
        )
        x = jnp.concatenate([jnp.moveaxis(known, 0, -1)[None].astype(self.dtype), features], -1)
        x = ConvNorm(self.config.width, dtype=self.dtype, name="hidden_0")(x, train=train)
        x = ConvNorm(self.config.width, dtype=self.dtype, name="hidden_1")(x, train=train)
        decided = nn.Conv(SECTORS + 1 + 9 + 1, (3, 3), dtype=self.dtype, name="decide")(x)[0]
        decided = jnp.moveaxis(decided.astype(jnp.float32), -1, 0)
        trust, doubt, around, correction = jnp.split(decided, [SECTORS, SECTORS + 1, SECTORS + 10])

        weights = nn.sigmoid(trust)
        # Never nothing: where nothing is known, a quotient of zeros has no gradient.
        doubted = jnp.exp(doubt[0] - 9.0) + 0.1 * LEAST_INFORMATION
        information = (weights * steps.information).sum(0) + doubted
        moved = disparity + jnp.clip((weights * steps.push).sum(0) / information, -largest, largest)
        # Begins near the pixel itself: smoothing is learned where it helps.
        itself = jnp.where(jnp.arange(9) == 4, 3.0, 0.0)[:, None, None]
        smoothing = jax.nn.softmax(around + itself, axis=0)
        return (smoothing * neighbours(moved)).sum(0) + 0.1 * correction[0]
