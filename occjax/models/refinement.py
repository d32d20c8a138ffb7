"""The last step: sub-pixel disparity, chosen from what sectors and fitted planes propose."""

from __future__ import annotations

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.models.config import RefinementConfig
from occjax.models.layers import ConvRelu
from occjax.ops.filtering import WINDOW, neighbours
from occjax.ops.sectors import SECTORS, SectorSteps

LEAST_INFORMATION = 1e-6
"""That of a gradient of 0.1 %: a pixel with less has no step of its own."""


CERTAIN = 4.5
"""Score, before training, of what is to be kept as it is."""


class SectorRefinement(nn.Module):
    """A mean of the proposals with learned weights.

    The network weighs the sectors (an occluded one counts nothing) and decides how far to trust
    their step at all, ``sum w_s push_s / (sum w_s information_s + lambda)``; then how much to take
    of the disparity as it is, of each kind's step and of the planes; then each pixel becomes a mean
    of its 3x3 neighbours, plus a small correction. Before training it hardly changes the disparity.

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
        steps: list[SectorSteps],
        planes: Float[Array, "h w"],
        features: Float[Array, "1 h w c"],
    ) -> Float[Array, "h w"]:
        """Refined disparity.

        Args:
            disparity: ``[h, w]``, right to a fraction of a pixel.
            steps: Of all sectors, for each kind of image that views are compared by.
            planes: ``[h, w]`` disparity of planes fitted to those steps.
            features: ``[1, h, w, c]`` of the stage before.

        Returns:
            ``[h, w]``.
        """
        moves = self._bounded(planes - disparity)[None]
        known = jnp.concatenate([moves, *map(self._known, steps)])
        x = jnp.concatenate([jnp.moveaxis(known, 0, -1)[None].astype(self.dtype), features], -1)
        x = ConvRelu(self.config.width, dtype=self.dtype, name="hidden_0")(x)
        x = ConvRelu(self.config.width, dtype=self.dtype, name="hidden_1")(x)

        def decide(count, name, start=None):
            layer = nn.Conv(
                count,
                (3, 3),
                kernel_init=nn.initializers.zeros,
                bias_init=first_score(start),
                dtype=self.dtype,
                name=name,
            )
            return jnp.moveaxis(layer(x)[0].astype(jnp.float32), -1, 0)

        options = [disparity, planes]
        for index, kind in enumerate(steps):
            trust = decide(SECTORS + 1, f"trust_{index}")
            options.append(disparity + self._step(trust, kind))
        shares = jax.nn.softmax(decide(len(options), "choice", start=0), axis=0)
        chosen = (shares * jnp.stack(options)).sum(0)
        smoothing = jax.nn.softmax(decide(9, "smoothing", start=WINDOW.index((0, 0))), axis=0)
        return (smoothing * neighbours(chosen, WINDOW)).sum(0) + 0.1 * decide(1, "correction")[0]

    def _bounded(self, step: Float[Array, "*n h w"]) -> Float[Array, "*n h w"]:
        return jnp.clip(step / self.config.largest_step, -1.0, 1.0)

    def _known(self, steps: SectorSteps) -> Float[Array, "k h w"]:
        """Steps as values of about one: themselves by their bound, sums by their logarithm."""
        every = steps.push.sum(0) / (steps.information.sum(0) + LEAST_INFORMATION)
        return jnp.concatenate(
            [
                self._bounded(steps.push / (steps.information + LEAST_INFORMATION)),
                self._bounded(every)[None],
                0.3 * jnp.log(steps.information + LEAST_INFORMATION),
                0.3 * jnp.log(steps.squares + 1e-7),
            ]
        )

    def _step(self, trust, steps: SectorSteps) -> Float[Array, "h w"]:
        """The step to the minimum of the sectors' weighted sum, damped."""
        weights = nn.sigmoid(trust[:SECTORS])
        # Never nothing: where nothing is known, a quotient of zeros has no gradient.
        damping = jnp.exp(trust[SECTORS] - 9.0) + 0.1 * LEAST_INFORMATION
        information = (weights * steps.information).sum(0) + damping
        step = (weights * steps.push).sum(0) / information
        return jnp.clip(step, -self.config.largest_step, self.config.largest_step)


def first_score(favoured: int | None) -> nn.initializers.Initializer:
    """Scores before training: one option is favoured, or all are alike."""
    if favoured is None:
        return nn.initializers.zeros
    return lambda key, shape, dtype: jnp.zeros(shape, dtype).at[favoured].set(CERTAIN)
