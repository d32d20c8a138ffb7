"""Region voting against loops over the pixels of the window, and against a scene of known gaps."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.models.proposal.config import VotingConfig
from occjax.models.proposal.voting import (
    Votes,
    election_scores,
    region_votes,
    replace_outvoted,
)

votes_of = jax.jit(region_votes, static_argnames="config")
CONFIG = VotingConfig()


def counted(disparity, slopes, confidence, appearance, candidates, config):
    """Count the votes pixel by pixel."""
    h, w = disparity.shape
    reach = range(-config.radius_px, config.radius_px + 1, config.step_px)
    spacing = candidates[1] - candidates[0]
    votes = np.zeros((len(candidates), h, w))
    for y, x in np.ndindex(h, w):
        for down in reach:
            for right in reach:
                i, j = y + down, x + right
                if not (0 <= i < h and 0 <= j < w):
                    continue
                difference = np.mean(np.abs(appearance[:, i, j] - appearance[:, y, x]))
                similarity = max(0.0, 1.0 - difference / (4 * config.appearance_scale)) ** 4
                surface = disparity[i, j] - down * slopes[0, i, j] - right * slopes[1, i, j]
                share = np.maximum(0.0, 1.0 - np.abs(candidates - surface) / spacing)
                votes[:, y, x] += confidence[i, j] ** config.confidence_power * similarity * share
    return votes / len(reach) ** 2


@pytest.mark.parametrize("size", [(6, 7), (5, 4)])
def test_votes_are_those_of_loops_over_the_window(size, tolerance):
    rng = np.random.default_rng(0)
    disparity, slopes = rng.uniform(-1, 1, size), rng.uniform(-0.1, 0.1, (2, *size))
    confidence, appearance = rng.random(size), rng.uniform(0, 0.05, (3, *size))
    candidates = np.linspace(-1.5, 1.5, 7)
    config = VotingConfig(radius_px=2, step_px=1, appearance_scale=0.02, min_distance=0.8)
    arguments = disparity, slopes, confidence, appearance, candidates
    found = votes_of(*(jnp.asarray(each, jnp.float32) for each in arguments), config=config)
    expected = counted(*arguments, config)
    for y, x in np.ndindex(size):
        here = expected[:, y, x]

        def interpolated(at, here=here):
            return np.interp(at, candidates, here)

        remaining = here
        for elected, received in zip(found.elected, found.received, strict=True):
            winner = candidates[np.argmax(remaining)]
            near = np.abs(candidates - winner) < 0.6
            mean = np.average(candidates[near], weights=remaining[near] + 1e-15)
            np.testing.assert_allclose(elected[y, x], mean, **tolerance("amplified"))
            np.testing.assert_allclose(received[y, x], interpolated(mean), **tolerance("amplified"))
            far = np.abs(candidates - float(elected[y, x])) > config.min_distance
            remaining = np.where(far, remaining, 0.0)
        own = interpolated(disparity[y, x])
        np.testing.assert_allclose(found.own[y, x], own, **tolerance("amplified"))


def test_scores_are_a_logistic_regression():
    pixel = np.ones((1, 1), np.float32)
    votes = Votes(jnp.stack([pixel, -pixel]), jnp.stack([0.2 * pixel, 0.01 * pixel]), 0.05 * pixel)
    proposed = jnp.stack([0.9 * pixel, 0.5 * pixel, -3.0 * pixel])
    probabilities = jnp.stack([0.3 * pixel, 0.6 * pixel, 0.1 * pixel])
    increase = jnp.stack([0.1 * pixel, -0.2 * pixel])
    scores = election_scores(votes, increase, proposed, probabilities, CONFIG)[:, 0, 0]
    for score, received, cost, probability in zip(
        scores, (0.2, 0.01), (0.1, -0.2), (0.3, 0.6), strict=True
    ):
        expected = (
            CONFIG.bias
            + CONFIG.votes * math.log((received + 1e-4) / (0.05 + 1e-4))
            + CONFIG.cost_increase * cost
            + CONFIG.proposal_probability * math.log(probability + 1e-4)
        )
        assert float(score) == pytest.approx(expected, rel=1e-5)


def test_nothing_is_elected_without_votes():
    own, flat = jnp.full((8, 8), 0.5), jnp.zeros((2, 8, 8))
    config = VotingConfig(radius_px=6, step_px=3)
    candidates = jnp.linspace(-2.0, 2.0, 9)
    votes = votes_of(own, flat, jnp.zeros((8, 8)), flat[:1], candidates, config=config)
    scores = election_scores(votes, flat, own[None], jnp.ones((1, 8, 8)), config)
    np.testing.assert_array_equal(replace_outvoted(own, votes.elected, scores, config), own)


def test_only_changes_that_neighbours_share_are_made():
    disparity = jnp.zeros((9, 9))
    better = jnp.zeros((9, 9)).at[2:7, 2:7].set(1.0)
    elected = jnp.stack([better, -jnp.ones((9, 9))])
    rejected = jnp.full((9, 9), -1.0)
    accepted = jnp.where(better > 0, 2.0, -1.0)
    replaced = replace_outvoted(disparity, elected, jnp.stack([accepted, rejected]), CONFIG)
    np.testing.assert_array_equal(replaced[3:6, 3:6], 1.0)
    np.testing.assert_array_equal(replaced[0], 0.0)
    single = rejected.at[4, 4].set(2.0)
    kept = replace_outvoted(disparity, elected, jnp.stack([single, rejected]), CONFIG)
    np.testing.assert_array_equal(kept, disparity)
    small = elected * 0.9 * CONFIG.min_change
    everywhere = jnp.full((2, 9, 9), 2.0)
    np.testing.assert_array_equal(replace_outvoted(disparity, small, everywhere, CONFIG), disparity)


def test_the_gaps_between_leaves_get_the_disparity_of_the_wall():
    """A wall of one colour around leaves whose gaps have the disparity of the leaves."""
    wall, leaf = -1.0, 2.0
    truth = np.full((48, 48), wall)
    truth[16:32, 16:32] = leaf
    truth[22:26, 16:32] = wall  # a gap
    colour = np.where(truth == wall, 0.2, 0.6)[None].repeat(3, 0)
    fattened = truth.copy()
    fattened[22:26, 17:31] = leaf
    confidence = np.where(fattened == truth, 1.0, 0.6)
    maps = (fattened, np.zeros((2, 48, 48)), confidence, colour, np.linspace(-3, 3, 25))
    config = dataclasses.replace(CONFIG, radius_px=18, step_px=3)
    votes = votes_of(*(jnp.asarray(each, jnp.float32) for each in maps), config=config)
    # The costs of a blank surface tell nothing apart.
    proposed = jnp.asarray(np.stack([fattened, np.full_like(fattened, wall)]), jnp.float32)
    even = jnp.full(proposed.shape, 0.5)
    scores = election_scores(votes, jnp.zeros((2, 48, 48)), proposed, even, config)
    voted = replace_outvoted(proposed[0], votes.elected, scores, config)
    assert np.mean(np.abs(fattened - truth) > 0.1) > 0.02
    # The median filter rounds the corners of the leaves.
    assert np.mean(np.abs(voted - truth) > 0.1) < 0.005


@pytest.mark.parametrize(
    "wrong",
    [
        {"step_px": 5},
        {"step_px": 0},
        {"radius_px": -6},
        {"appearance_scale": 0.0},
        {"confidence_power": -1.0},
        {"min_change": -0.1},
    ],
)
def test_settings_that_cannot_work_are_refused(wrong):
    with pytest.raises(ValueError, match="must be"):
        VotingConfig(**wrong)
