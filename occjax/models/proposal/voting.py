"""Region voting: confident pixels of similar colour in a window vote for the disparity of a pixel.

The gaps between leaves show a blank wall. Seen from other views, a gap moves with the leaves, so
that its costs at the disparity of the leaves are as low as at that of the wall. All neighbours may
be leaves. But the disparity of the wall is known in other parts of the window.
As in the region voting of AD-Census (Mei et al., On Building an Accurate Stereo Matching System on
Graphics Hardware, ICCV Workshops 2011), the pixels of the region vote for their disparities. A
disparity with many votes replaces that of the pixel if its costs do not contradict.

Disparities are those at the configured reach.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.kernels.median import median_filter
from occjax.kernels.reductions import max_leading, min_leading, sum_leading
from occjax.models.proposal.config import VotingConfig
from occjax.models.proposal.search import candidate_spacing
from occjax.models.proposal.support import pad_window_maps


class Votes(NamedTuple):
    """Disparities with most votes of the pixels around each pixel.

    Attributes:
        elected: ``[2, h, w]`` the disparity with most votes, and that with most votes farther than
            ``min_distance`` from it.
        received: ``[2, h, w]`` votes of both, in [0, 1].
        own: ``[h, w]`` votes of the pixel's own disparity.
    """

    elected: Float[Array, "2 h w"]
    received: Float[Array, "2 h w"]
    own: Float[Array, "h w"]


def region_votes(
    disparity: Float[Array, "h w"],
    slopes: Float[Array, "2 h w"],
    confidence: Float[Array, "h w"],
    appearance: Float[Array, "c h w"],
    candidates: Float[Array, " d"],
    config: VotingConfig,
) -> Votes:
    """Count the votes for all candidates at each pixel and return those with most votes.

    A pixel votes for the disparity of its surface, continued by its slope. The weight of its vote
    is the product of ``confidence ** confidence_power`` and its similarity, which is
    ``max(0, 1 - difference / (4 appearance_scale)) ** 4``. The difference is the mean absolute
    difference of the channels. The vote is divided between both neighbouring candidates.

    Args:
        disparity: ``[h, w]`` disparity of each pixel.
        slopes: ``[2, h, w]`` its slope along rows and columns, per pixel.
        confidence: ``[h, w]`` its confidence in [0, 1].
        appearance: ``[c, h, w]`` colour or grey of the centre view.
        candidates: ``[d]`` evenly spaced disparities; disparities outside their range receive no
            votes.
        config: Settings.

    Returns:
        The votes, relative to the number of pixels in the window.

    Example:
        >>> blue = jnp.arange(16) < 8
        >>> appearance = jnp.tile(jnp.where(blue, 0.2, 0.6), (1, 16, 1))
        >>> disparity = jnp.tile(jnp.where(blue, -1.0, 2.0), (16, 1)).at[8, 4].set(2.0)
        >>> flat, certain = jnp.zeros((2, 16, 16)), jnp.ones((16, 16)).at[8, 4].set(0.5)
        >>> config = VotingConfig(radius_px=6, step_px=2)
        >>> candidates = jnp.linspace(-3.0, 3.0, 25)
        >>> votes = region_votes(disparity, flat, certain, appearance, candidates, config)
        >>> round(float(votes.elected[0, 8, 4]), 3)
        -1.0
    """
    height, width = disparity.shape
    radius, channels = config.radius_px, len(appearance)
    candidates = candidates.astype(disparity.dtype)
    spacing = candidate_spacing(candidates)
    grid = candidates[:, None, None]
    weights = confidence**config.confidence_power
    padded = pad_window_maps(appearance, disparity, slopes, weights, radius)
    steps = jnp.arange(0, 2 * radius + 1, config.step_px)
    starts = jnp.stack(jnp.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)

    def nearness(distance: Array) -> Array:
        """Return 1 at a candidate, falling to 0 at its neighbours."""
        return jnp.maximum(1.0 - jnp.abs(distance) / spacing, 0.0)

    # The votes of a few rows stay in the cache.
    rows = math.gcd(height, 16)

    def count(first: Array) -> Votes:
        own_look = jax.lax.dynamic_slice(appearance, (0, first, 0), (channels, rows, width))

        def add(votes: Array, start: Array) -> tuple[Array, None]:
            at = (0, first + start[0], start[1])
            shifted = jax.lax.dynamic_slice(padded, at, (len(padded), rows, width))
            difference = sum_leading(jnp.abs(shifted[:channels] - own_look)) / channels
            surface, slope_down, slope_right, weight = shifted[channels:]
            down, right = (start - radius).astype(disparity.dtype)
            surface = surface - down * slope_down - right * slope_right
            # On a CPU, an exponential function would take three times as long as all the rest.
            similarity = jnp.maximum(1.0 - difference / (4.0 * config.appearance_scale), 0.0) ** 4
            near = nearness(candidates[None, None] - surface[..., None])
            return votes + (weight * similarity)[..., None] * near, None

        # With the candidates as last axis, XLA computes surface and weight once for all of them.
        empty = jnp.zeros((rows, width, len(candidates)), disparity.dtype)
        votes = jnp.moveaxis(jax.lax.scan(add, empty, starts)[0] / len(starts), -1, 0)

        def elect(votes: Array) -> Array:
            """Return the mean disparity of the votes around the candidate with most votes."""
            winner = candidates[jnp.argmax(votes, axis=0)]
            near = jnp.where(jnp.abs(grid - winner[None]) < 1.5 * spacing, votes, 0.0)
            return sum_leading(near * (grid - winner[None])) / (sum_leading(near) + 1e-12) + winner

        first_elected = elect(votes)
        distance = jnp.maximum(config.min_distance, 1.5 * spacing)
        far = jnp.abs(grid - first_elected[None]) > distance
        elected = jnp.stack([first_elected, elect(jnp.where(far, votes, 0.0))])
        own = jax.lax.dynamic_slice(disparity, (first, 0), (rows, width))
        of_each = [sum_leading(votes * nearness(grid - each[None])) for each in (*elected, own)]
        return Votes(elected, jnp.stack(of_each[:2]), of_each[2])

    strips = jax.lax.map(count, rows * jnp.arange(height // rows))
    return jax.tree.map(
        lambda maps: jnp.moveaxis(maps, 0, -3).reshape(*maps.shape[1:-2], height, width), strips
    )


def election_scores(
    votes: Votes,
    cost_increase: Float[Array, "2 h w"],
    proposed: Float[Array, "k h w"],
    probabilities: Float[Array, "k h w"],
    config: VotingConfig,
) -> Float[Array, "2 h w"]:
    """Compute the log-odds that the elected disparities are better than that of the pixel.

    This is a logistic regression with the coefficients of the configuration.

    Args:
        votes: Votes of the pixels around each pixel.
        cost_increase: ``[2, h, w]`` matching costs of the elected disparities minus that of the
            pixel's own disparity.
        proposed: ``[k, h, w]`` proposed disparities of the selection.
        probabilities: ``[k, h, w]`` probability of each proposal.
        config: Settings.
    """

    def closest(elected: Float[Array, "h w"]) -> Float[Array, "h w"]:
        """Return the probability of the closest proposal."""
        distance = jnp.abs(proposed - elected[None])
        is_closest = distance == min_leading(distance)[None]
        return max_leading(jnp.where(is_closest, probabilities, 0.0))

    probability = jnp.stack([closest(elected) for elected in votes.elected])
    scores = (
        config.bias
        + config.votes * jnp.log((votes.received + 1e-4) / (votes.own[None] + 1e-4))
        + config.cost_increase * cost_increase
        + config.proposal_probability * jnp.log(probability + 1e-4)
    )
    # Without votes, the first candidate is elected.
    return jnp.where(votes.received > 0.0, scores, -jnp.inf)


def replace_outvoted(
    disparity: Float[Array, "h w"],
    elected: Float[Array, "2 h w"],
    scores: Float[Array, "2 h w"],
    config: VotingConfig,
) -> Float[Array, "h w"]:
    """Replace the disparity of pixels by an elected one of positive score.

    A median filter follows. It undoes a change of a single pixel, and changes single pixels among
    changed ones.

    Args:
        disparity: ``[h, w]`` disparity of each pixel.
        elected: ``[2, h, w]`` elected disparities.
        scores: ``[2, h, w]`` log-odds that they are better.
        config: Settings.

    Returns:
        ``[h, w]`` disparity, unchanged where the difference would be at most ``min_change``.
    """
    different = jnp.abs(elected - disparity[None]) > config.min_change
    scores = jnp.where(different, scores, -jnp.inf)
    best = jnp.where(scores[0] >= scores[1], elected[0], elected[1])
    median = median_filter(jnp.where(max_leading(scores) > 0.0, best, disparity))
    return jnp.where(jnp.abs(median - disparity) > config.min_change, median, disparity)
