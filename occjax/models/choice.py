"""The learned part of the light network: which of its proposals each pixel takes."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.models.config import Choice
from occjax.models.layers import (
    ImageConv,
    Residual3x3,
    depth_to_space,
    space_to_depth,
)
from occjax.models.proposals import BEST_HALF, Proposals
from occjax.ops.filtering import central_differences, neighbours
from occjax.ops.planes import greatest_plane, sum_planes
from occjax.ops.resolution import double, halve

LITTLE = 0.003
"""Cost below which differences between proposals are noise."""

ALIKE = 0.05
"""Difference of two proposals at which they half agree, and of grey at which pixels half do."""

UNTRAINED = 3.0
"""Score, before training, of the disparity as it is; all other proposals have 0."""


class ProposalChoice(nn.Module):
    """A score for each proposal of each pixel.

    All proposals go through the same convolutions, so what is learned of one is learned of all and
    their number and order do not matter. A neighbour is known by what lies at its place and on the
    way there: a pixel belongs to the surface of those that look like it. Twice they hear of each
    other: through the mean and the maximum over the proposals, which a second, narrowing network
    looks at together with the centre view. All of it works at half resolution with the four pixels
    of a block as channels.

    Attributes:
        config: Its widths.
        places: How far away, ``(rows, columns)``, are the neighbours that propose.
        dtype: Type of the convolutions.
    """

    config: Choice
    places: tuple[tuple[int, int], ...]
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(self, proposals: Proposals) -> Float[Array, "k h w"]:
        """Scores; the higher, the likelier the proposal.

        Args:
            proposals: Of images whose height and width are multiples of
                ``2 ** len(config.context)``.
        """
        width = self.config.width
        # One by one, so that they are never all there in single precision.
        level = sum(cost.astype(jnp.float32) for cost in proposals.costs) / len(proposals.costs)
        sources = ((0, 0), *self.places, (0, 0))  # itself, the neighbours, the second surface
        variations = _variations(proposals.centre, sources)

        def per_pixel(maps: Float[Array, "n c h w"]) -> Float[Array, "n i j _"]:
            return space_to_depth(jnp.moveaxis(maps, 1, -1)).astype(self.dtype)

        enter = nn.Dense(width, dtype=self.dtype, name="enter")
        residual = Residual3x3(dtype=self.dtype, name="residual_0")

        def entered(some: slice) -> Float[Array, "n i j _"]:
            speaking = [
                _what_speaks_for_each(proposals, some, level),
                _who_proposes(proposals, some, sources, variations),
            ]
            maps = jax.lax.stop_gradient(jnp.concatenate(speaking, axis=1))
            return residual(nn.relu(enter(per_pixel(maps))))

        groups = [entered(some) for some in _in_groups(proposals)]
        seen = [
            (proposals.centre - 0.5)[None],
            jnp.stack(central_differences(proposals.disparity)),
            proposals.spread,
            # Relative costs do not know how much the views differ at all.
            0.3 * jnp.log(level + LITTLE),
        ]
        context = self._context(
            jnp.concatenate([_over_all(groups), per_pixel(jnp.concatenate(seen)[None])], axis=-1)
        )
        gate, shift = jnp.split(
            nn.Dense(2 * width, dtype=self.dtype, name="context")(context), 2, axis=-1
        )
        gate = nn.sigmoid(gate)
        norm = nn.LayerNorm(dtype=self.dtype, name="gated_norm")
        residual = Residual3x3(dtype=self.dtype, name="residual_1")
        groups = [residual(nn.relu(norm(group * gate + shift))) for group in groups]
        others = nn.Dense(width, dtype=self.dtype, name="others")(_over_all(groups))
        leave = ImageConv(width, dtype=self.dtype, name="leave")
        score = nn.Dense(4, kernel_init=nn.initializers.zeros, dtype=self.dtype, name="score")
        scored = jnp.concatenate([score(nn.relu(leave(group) + others)) for group in groups])
        scores = depth_to_space(scored)[..., 0].astype(jnp.float32)
        stay = self.param("stay", nn.initializers.constant(UNTRAINED), (), jnp.float32)
        return scores.at[0].add(stay)

    def _context(self, x: Float[Array, "1 i j c"]) -> Float[Array, "1 i j k"]:
        """What large surroundings say, from half the resolution down and back."""
        widths = self.config.context

        def block(x, level, name):
            x = ImageConv(widths[level], dtype=self.dtype, name=name)(x)
            return _normalised(x, name, self.dtype)

        x = nn.Dense(widths[0], dtype=self.dtype, name="context_enter")(x)
        x = _normalised(x, "context_enter", self.dtype)
        levels = [block(x, 0, "level_0")]
        for level in range(1, len(widths)):
            x = block(halve(levels[-1], (1, 2)), level, f"down_{level}_0")
            levels.append(block(x, level, f"down_{level}_1"))
        x = levels[-1]
        for level in reversed(range(len(widths) - 1)):
            below = nn.Dense(widths[level], dtype=self.dtype, name=f"widen_{level}")(x)
            x = block(levels[level] + double(below, (1, 2)), level, f"up_{level}")
        return x


def _normalised(x: Float[Array, "n i j c"], name: str, dtype: DTypeLike) -> Array:
    """Normalise over the channels of each pixel, rectify.

    Without it so many layers one after the other grow without bounds. Statistics over pixels or
    over light fields would depend on what else there is.
    """
    return nn.relu(nn.LayerNorm(dtype=dtype, name=f"{name}_norm")(x))


def _what_speaks_for_each(
    proposals: Proposals, some: slice, level: Float[Array, "13 h w"]
) -> Float[Array, "n 28 h w"]:
    """Costs relative to their mean over the proposals, costs as they are, how far it would go.

    What the contrast of the texture is must not matter for which proposal is the best.
    """
    costs = proposals.costs[some].astype(jnp.float32)
    relative = costs / (level + LITTLE)[None] - 1.0
    move = proposals.proposed[some] - proposals.disparity[None]
    maps = [
        jnp.clip(relative, -1.0, 3.0),
        jnp.sqrt(costs),
        (move / (jnp.abs(move) + 0.2))[:, None],
        jnp.clip(move / 0.2, -1.0, 1.0)[:, None],
    ]
    return jnp.concatenate(maps, axis=1)


def _who_proposes(
    proposals: Proposals,
    some: slice,
    sources: Sequence[tuple[int, int]],
    variations: Float[Array, "k h w"],
) -> Float[Array, "n 7 h w"]:
    """How alike a pixel and the one that proposes are, how certain that one is, who agrees.

    Difference of grey, sum of all differences on the way, whether it is a neighbour at all; spread
    of the neighbour's candidates, and what its own disparity costs it; how many other proposals say
    the same.
    """
    centre = proposals.centre
    sources, variation = sources[some], variations[some]
    difference = jnp.abs(neighbours(centre, sources) - centre[None])
    is_neighbour = jnp.array([place != (0, 0) for place in sources], centre.dtype)
    proposed = proposals.proposed
    agreement = 1.0 / (1.0 + jnp.square((proposed[:, None] - proposed[None, some]) / ALIKE))
    maps = [
        difference / (difference + ALIKE),
        variation / (variation + ALIKE),
        jnp.broadcast_to(is_neighbour[:, None, None], difference.shape),
        *(neighbours(one, sources) for one in proposals.spread),
        jnp.sqrt(neighbours(proposals.costs[0, BEST_HALF].astype(jnp.float32), sources)),
        _mean(agreement),
    ]
    return jnp.stack(maps, axis=1)


def _variations(
    centre: Float[Array, "h w"], places: Sequence[tuple[int, int]]
) -> Float[Array, "k h w"]:
    """Sum of all differences between neighbouring pixels on the way to each place."""
    reach = max(abs(step) for place in places for step in place)
    padded = jnp.pad(centre, reach, mode="edge")
    steps = [
        (number, before, after)
        for number, place in enumerate(places)
        for before, after in itertools.pairwise(_way(place))
    ]
    which, before, after = (np.array(column, np.int32) for column in zip(*steps, strict=True))

    def add(sums, step):
        number, *corners = step
        one, other = (jax.lax.dynamic_slice(padded, tuple(at), centre.shape) for at in corners)
        return sums.at[number].add(jnp.abs(other - one)), None

    # A loop: written out, this alone took a fifth of the time to compile the network.
    sums = jnp.zeros((len(places), *centre.shape), centre.dtype)
    return jax.lax.scan(add, sums, (which, before + reach, after + reach))[0]


def _way(place: tuple[int, int]) -> list[tuple[int, int]]:
    """The pixels from here to a place, both included."""
    steps = max(*map(abs, place), 1)
    return [
        (round(place[0] * step / steps), round(place[1] * step / steps))
        for step in range(steps + 1)
    ]


def _in_groups(proposals: Proposals) -> list[slice]:
    """Two at a time, which XLA convolves on a CPU twice as fast as ten at once."""
    return [slice(first, first + 2) for first in range(0, len(proposals.proposed), 2)]


def _over_all(groups: list[Float[Array, "k i j c"]]) -> Float[Array, "1 i j _"]:
    """Mean and maximum over the proposals."""
    number = sum(map(len, groups))
    mean = functools.reduce(jnp.add, map(sum_planes, groups)) / number
    most = functools.reduce(jnp.maximum, map(greatest_plane, groups))
    return jnp.concatenate([mean[None], most[None]], axis=-1)


def _mean(planes: Float[Array, "n ..."]) -> Float[Array, "..."]:
    return sum_planes(planes) / len(planes)
