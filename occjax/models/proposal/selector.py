"""The learned selection among the proposals of each pixel."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.kernels.padding import pad_borders
from occjax.kernels.reductions import max_leading, sum_leading
from occjax.models.proposal.config import SelectorConfig
from occjax.models.proposal.filters import central_differences, sample_at_offsets
from occjax.models.proposal.multi_scale import ImageConv, Residual3x3, multi_scale_features
from occjax.models.proposal.proposals import COST_CHANNELS, Proposals
from occjax.models.proposal.resolution import depth_to_space, space_to_depth

Offsets = Sequence[tuple[int, int]]


class ProposalSelector(nn.Module):
    """Score of each proposal of each pixel.

    The same convolutions are applied to all proposals, so that their number and order are free. A
    proposing neighbour is described by the image at its position and on the line to it: a pixel
    tends to belong to the surface of the pixels that look like it. The proposals exchange
    information twice, through their mean and maximum. The first time, these enter a second network
    of decreasing resolution together with the centre view. All convolutions work at half
    resolution, with the four pixels of a block as channels.

    Attributes:
        config: Widths and scales.
        offsets: Offsets ``(row, column)`` of the proposing neighbours, in pixels.
        dtype: Type of the convolutions.
    """

    config: SelectorConfig
    offsets: tuple[tuple[int, int], ...]
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(self, proposals: Proposals) -> Float[Array, "k h w"]:
        """Compute the scores.

        Args:
            proposals: Proposals; height and width must be multiples of
                ``2 ** len(config.context)``.

        Returns:
            ``[k, h, w]`` scores; a higher score means a more likely proposal.
        """
        config, width = self.config, self.config.width
        costs = proposals.costs.channels
        # Summed one by one: all costs in single precision would take too much memory.
        mean_costs = sum(cost.astype(jnp.float32) for cost in costs) / len(costs)
        # Offset of each proposal's source: the pixel itself, the neighbours, the second best.
        sources = ((0, 0), *self.offsets, (0, 0))
        source_features = proposal_source_features(proposals, sources, config.similarity)

        def as_blocks(maps: Float[Array, "n c h w"]) -> Float[Array, "n i j _"]:
            return space_to_depth(jnp.moveaxis(maps, 1, -1)).astype(self.dtype)

        def encode(costs, proposed, source_features):
            change = proposed - proposals.disparity[None]
            cost_features = proposal_cost_features(costs, change, mean_costs, config.cost_floor)
            features = jnp.concatenate([cost_features, source_features], axis=1)
            enter = nn.Dense(width, dtype=self.dtype, name="enter")
            residual = Residual3x3(dtype=self.dtype, name="residual_0")
            return residual(nn.relu(enter(as_blocks(jax.lax.stop_gradient(features)))))

        encoded = _map_pairs(self, encode, costs, proposals.proposed, source_features)
        image_features = [
            (proposals.centre - 0.5)[None],
            jnp.stack(central_differences(proposals.disparity)),
            proposals.log_variance[None],
            proposals.peak_probability[None],
            # The absolute costs, since the cost features are relative.
            0.3 * jnp.log(mean_costs + config.cost_floor),
        ]
        image = as_blocks(jnp.concatenate(image_features)[None])
        features = jnp.concatenate([_mean_and_max(encoded), image], axis=-1)
        context = multi_scale_features(features, config.context, self.dtype)
        gate, shift = jnp.split(
            nn.Dense(2 * width, dtype=self.dtype, name="context")(context), 2, axis=-1
        )
        gate = nn.sigmoid(gate)

        def compare(encoded):
            norm = nn.LayerNorm(dtype=self.dtype, name="gated_norm")
            residual = Residual3x3(dtype=self.dtype, name="residual_1")
            return residual(nn.relu(norm(encoded * gate + shift)))

        compared = _map_pairs(self, compare, encoded)
        others = nn.Dense(width, dtype=self.dtype, name="others")(_mean_and_max(compared))

        def score(compared):
            leave = ImageConv(width, dtype=self.dtype, name="leave")
            dense = nn.Dense(4, kernel_init=nn.initializers.zeros, dtype=self.dtype, name="score")
            return dense(nn.relu(leave(compared) + others))

        scores = depth_to_space(_map_pairs(self, score, compared))[..., 0].astype(jnp.float32)
        bias = nn.initializers.constant(config.initial_bias)
        return scores.at[0].add(self.param("stay", bias, (), jnp.float32))


def proposal_cost_features(
    costs: Float[Array, f"n {COST_CHANNELS} h w"],
    change: Float[Array, "n h w"],
    mean_costs: Float[Array, f"{COST_CHANNELS} h w"],
    floor: float,
) -> Float[Array, f"n {2 * COST_CHANNELS + 2} h w"]:
    """Return costs relative to their mean over the proposals, absolute costs, and the change.

    Relative costs do not depend on the contrast of the texture.
    """
    costs = costs.astype(jnp.float32)
    relative = costs / (mean_costs + floor)[None] - 1.0
    maps = [
        jnp.clip(relative, -1.0, 3.0),
        jnp.sqrt(costs),
        (change / (jnp.abs(change) + 0.2))[:, None],
        jnp.clip(change / 0.2, -1.0, 1.0)[:, None],
    ]
    return jnp.concatenate(maps, axis=1)


def proposal_source_features(
    proposals: Proposals, sources: Offsets, similarity: float
) -> Float[Array, "k 7 h w"]:
    """Return the similarity of a pixel to the source of each proposal and the source's certainty.

    The seven maps: grey difference, sum of grey differences on the line to the source, whether the
    source is a neighbour, log variance and peak probability of the search at the source, the cost
    of the source's own disparity, and the fraction of proposals that agree.
    """
    centre, proposed = proposals.centre, proposals.proposed
    contrast = path_contrasts(centre, sources)
    difference = jnp.abs(sample_at_offsets(centre, sources) - centre[None])
    is_neighbour = jnp.array([source != (0, 0) for source in sources], centre.dtype)
    source_cost = proposals.costs.best_half[0].astype(jnp.float32)

    def agreement(one: Float[Array, "h w"]) -> Float[Array, "h w"]:
        distance = (proposed - one[None]) / similarity
        return sum_leading(1.0 / (1.0 + jnp.square(distance))) / len(proposed)

    maps = [
        difference / (difference + similarity),
        contrast / (contrast + similarity),
        jnp.broadcast_to(is_neighbour[:, None, None], difference.shape),
        sample_at_offsets(proposals.log_variance, sources),
        sample_at_offsets(proposals.peak_probability, sources),
        jnp.sqrt(sample_at_offsets(source_cost, sources)),
        jax.lax.map(agreement, proposed),
    ]
    return jnp.stack(maps, axis=1)


def path_contrasts(centre: Float[Array, "h w"], offsets: Offsets) -> Float[Array, "k h w"]:
    """Sum the absolute grey differences of neighbouring pixels on the line to each offset.

    Args:
        centre: ``[h, w]`` grey image, borders replicated.
        offsets: Offsets ``(row, column)``, in pixels.

    Returns:
        ``[k, h, w]``, one map per offset.

    Example:
        >>> ramp = jnp.tile(jnp.arange(8.0), (8, 1))
        >>> path_contrasts(ramp, [(0, 0), (0, 3), (3, 0)])[:, 4, 2].tolist()
        [0.0, 3.0, 0.0]
    """
    radius = max(abs(step) for offset in offsets for step in offset)
    padded = pad_borders(centre, (radius, radius), (radius, radius))
    steps = [
        (index, before, after)
        for index, offset in enumerate(offsets)
        for before, after in itertools.pairwise(line_pixels(offset))
    ]
    index, before, after = (np.array(column, np.int32) for column in zip(*steps, strict=True))

    def add(sums, step):
        index, *starts = step
        one, other = (jax.lax.dynamic_slice(padded, tuple(at), centre.shape) for at in starts)
        return sums.at[index].add(jnp.abs(other - one)), None

    # An unrolled loop would account for a fifth of the time to compile the network.
    sums = jnp.zeros((len(offsets), *centre.shape), centre.dtype)
    return jax.lax.scan(add, sums, (index, before + radius, after + radius))[0]


def line_pixels(offset: tuple[int, int]) -> list[tuple[int, int]]:
    """Return the pixels of the line from (0, 0) to an offset, both included."""
    steps = max(*map(abs, offset), 1)
    return [
        (round(offset[0] * step / steps), round(offset[1] * step / steps))
        for step in range(steps + 1)
    ]


def _map_pairs(module: nn.Module, function: Callable[..., Array], *stacks: Array) -> Array:
    """Apply layers to two proposals at a time, with the same parameters.

    On a CPU, XLA convolves proposals twice as fast in pairs as ten at once. A loop needs 0.6 of the
    memory of the same layers written once per pair, and is compiled in 0.6 of the time.
    """

    def body(_, carry: None, pair: tuple[Array, ...]) -> tuple[None, Array]:
        return carry, function(*pair)

    loop = nn.scan(body, variable_broadcast="params", split_rngs={"params": False})
    pairs = jax.tree.map(lambda stack: stack.reshape(-1, 2, *stack.shape[1:]), stacks)
    mapped = loop(module, None, pairs)[1]
    return mapped.reshape(-1, *mapped.shape[2:])


def _mean_and_max(proposals: Float[Array, "k i j c"]) -> Float[Array, "1 i j _"]:
    """Return mean and maximum over all proposals."""
    mean, largest = sum_leading(proposals) / len(proposals), max_leading(proposals)
    return jnp.concatenate([mean[None], largest[None]], axis=-1)
