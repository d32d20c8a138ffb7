"""The volume around a disparity map against NumPy loops, and what any residual must satisfy."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.lightfield import view_offsets
from occjax.models import preset
from occjax.models.proposal import ProposalNet, ResidualConfig
from occjax.models.proposal.network import random_variables
from occjax.models.proposal.residual import (
    ResidualStage,
    ResidualVolume,
    ViewStatistics,
    residual_volume,
)
from occjax.models.proposal.search import GreyViews
from tests.reference import variables as reference_variables
from tests.reference.matching import bilinear, other_views
from tests.scenes import plane

CONFIG = ResidualConfig(candidates=(-0.2, 0.0, 0.2), widths=(4, 8))


def half_differences(image):
    """Return half of the difference of both neighbours, borders replicated."""
    padded = np.pad(image, 1, mode="edge")
    return (padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2, (padded[1:-1, 2:] - padded[1:-1, :-2]) / 2


def loop_statistics(views, offsets, disparity, candidates, tolerance):
    """Return the four statistics ``[4, d, h, w]`` over the views, one pixel at a time."""
    h, w = disparity.shape
    maps = {index: (views[index], *half_differences(views[index])) for index in np.ndindex(3, 3)}
    statistics = np.zeros((4, len(candidates), h, w))
    for k, y, x in np.ndindex(len(candidates), h, w):
        grey, squares = [], []
        for index, offset, _ in other_views(offsets):
            row, column = [y, x] - (disparity[y, x] + candidates[k]) * offset
            if 0 <= row <= h - 1 and 0 <= column <= w - 1:
                seen = [
                    bilinear(each, row, column) - each_here[y, x]
                    for each, each_here in zip(maps[index], maps[1, 1], strict=True)
                ]
                grey.append(seen[0])
                squares.append(seen[1] ** 2 + seen[2] ** 2)
        grey, squares = np.array(grey), np.array(squares)
        statistics[:, k, y, x] = (
            0.3 * np.log(np.mean(grey**2) + 1e-7),
            0.3 * np.log(np.mean(squares) + 1e-7),
            np.mean(squares / (squares + tolerance**2)),
            0.3 * np.log(np.var(grey) + 1e-7),
        )
    return statistics


def test_statistics_are_those_over_the_views_that_see_a_point(uniform):
    offsets = view_offsets(3, 3)
    views, disparity = uniform(3, 3, 7, 8), uniform(7, 8, seed=1) - 0.5
    volume = jax.jit(residual_volume, static_argnums=4)(
        GreyViews(views, jnp.asarray(offsets)), disparity, disparity, disparity + 0.5, CONFIG
    )
    expected = loop_statistics(
        *map(np.asarray, (views, offsets, disparity)), CONFIG.candidates, 0.004
    )
    # Pixels without views get a thousandth of a view, which changes small variances by a percent.
    np.testing.assert_allclose(volume.reference, expected[:, 1], atol=1e-2)
    np.testing.assert_allclose(volume.relative, expected - expected[:, 1:2], atol=1e-2)


def test_the_cheapest_candidate_is_correct_on_a_textured_plane():
    """The disparity is off by one of the candidates, and the mean squares of grey show it."""
    scene = plane(grid=(3, 3), size=(24, 32), disparity=0.6, slope=(0.004, 0.0))
    views, truth = jnp.asarray(scene.grey()), jnp.asarray(scene.ground_truth)
    config = ResidualConfig()
    candidates = np.array(config.candidates)
    volume = residual_volume(
        GreyViews(views, jnp.asarray(view_offsets(3, 3))),
        truth - 0.3,
        jnp.ones_like(truth),
        jnp.ones_like(truth),
        config,
    )
    cheapest = candidates[np.argmin(ViewStatistics(*volume.relative).log_square, axis=0)]
    assert np.mean((cheapest == candidates[-1])[4:-4, 4:-4]) > 0.9


@pytest.fixture(scope="module")
def volume(uniform):
    """Random volume of 8x12 pixels."""
    maps = uniform(4, 8, 12)
    relative = uniform(4, 3, 8, 12, seed=1) - 0.5
    return ResidualVolume(maps[0], maps[1], relative[:, 1], relative, maps[2], maps[3])


def test_an_untrained_residual_is_zero_and_keeps_the_confidence(volume):
    stage = ResidualStage(CONFIG)
    variables = stage.init(jax.random.key(0), volume)
    residual = stage.apply(variables, volume)
    assert np.abs(residual.disparity).max() < 1e-7
    np.testing.assert_allclose(residual.confidence, volume.certainty, atol=1e-3)


def test_a_residual_is_between_the_outermost_candidates(volume, tolerance):
    stage = ResidualStage(CONFIG)
    variables = stage.init(jax.random.key(0), volume)
    score = variables["params"]["score"]
    for bias, expected in ((-100.0, -0.2), (100.0, 0.2)):
        # All weight on the first or the last candidate of each of the four pixels of a block.
        score["bias"] = jnp.tile(jnp.append(jnp.linspace(-bias, bias, 3), 0.0), 4)
        np.testing.assert_allclose(
            stage.apply(variables, volume).disparity, expected, **tolerance("absolute")
        )


def test_the_last_score_changes_the_odds_of_the_confidence(volume, tolerance):
    stage = ResidualStage(CONFIG)
    variables = stage.init(jax.random.key(0), volume)
    variables["params"]["score"]["bias"] = jnp.tile(jnp.array([0.0, 0.0, 0.0, 1.5]), 4)
    certainty = np.clip(np.float64(volume.certainty), 1e-4, 1 - 1e-3)
    odds = certainty / (1 - certainty) * np.exp(1.5)
    confidence = stage.apply(variables, volume).confidence
    np.testing.assert_allclose(confidence, odds / (1 + odds), **tolerance("float32"))


def test_the_network_adds_the_residual_to_the_disparity(uniform, tolerance):
    """With all weight on the last candidate every pixel moves by it, at the network's reach."""
    config = preset("proposal_small", support=None, planar=None, voting=None)
    variables = random_variables(config, jax.random.key(0))
    kept = dataclasses.replace(config, residual=None)
    views, candidates = uniform(3, 3, 16, 16), jnp.linspace(-3.0, 3.0, 13)

    def disparity(config, variables):
        apply = jax.jit(ProposalNet(config).apply)
        return np.asarray(apply(variables, views, candidates=candidates).disparity)

    score = variables["params"]["residual"]["score"]
    score["bias"] = jnp.tile(100.0 * jnp.arange(10.0), 4)  # the last one is of the confidence
    without = {"params": {"selector": variables["params"]["selector"]}}
    moved = disparity(config, variables) - disparity(kept, without)
    # Views one step away are scaled to the reach of four steps.
    # Two programs round differently.
    np.testing.assert_allclose(moved, 4 * config.residual.candidates[-1], **tolerance("float32"))


def test_shapes_of_variables_are_those_of_random_ones():
    config = preset("proposal_small")
    drawn = reference_variables.random_variables(config)["params"]
    assert set(drawn) == {"selector", "residual"}
    random = random_variables(config, jax.random.key(1))["params"]
    assert jax.tree.map(jnp.shape, random) == jax.tree.map(jnp.shape, drawn)


@pytest.mark.parametrize(
    "candidates", [(-0.1, 0.0, 0.2), (0.1, 0.0, -0.1), (-0.1, 0.1, 0.1), (-0.1, 0.1), ()]
)
def test_candidates_must_be_symmetric_with_zero(candidates):
    with pytest.raises(ValueError, match="ascending and symmetric about 0"):
        ResidualConfig(candidates=candidates)


def test_a_residual_needs_a_selector():
    with pytest.raises(ValueError, match="set residual=None too"):
        preset("proposal", selector=None)
