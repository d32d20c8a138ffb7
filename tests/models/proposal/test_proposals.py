"""Proposed disparities and their costs on planes."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.lightfield import view_offsets
from occjax.models import ProposalNet, ProposalNetConfig
from occjax.models.proposal import ProposalsConfig, proposals
from occjax.models.proposal.search import SearchResult
from tests.scenes import plane

continued_surfaces = jax.jit(proposals.continued_surfaces, static_argnums=(1, 2))


@pytest.mark.slow
def test_all_neighbours_on_one_surface_propose_its_disparity():
    # With a reach of 1, the disparities of a grid of 3x3 views are not scaled.
    config = ProposalNetConfig(reach=1.0)
    scene = plane(grid=(3, 3), size=(48, 48), disparity=0.4, slope=(0.01, 0.005))
    views, offsets = jnp.asarray(scene.grey()), jnp.asarray(view_offsets(3, 3))
    found = jax.jit(lambda *arrays: ProposalNet(config).apply({}, *arrays, method="propose"))(
        views, offsets
    )
    np.testing.assert_array_equal(found.proposed[0], found.disparity)
    inner, truth = np.s_[..., 14:-14, 14:-14], scene.ground_truth
    # Ten rows away the disparity of the surface differs by 0.1.
    for proposed in (found.disparity, found.proposed[1:9]):
        assert np.median(np.abs(np.asarray(proposed) - truth)[inner]) < 0.03
    distance = np.abs(np.asarray(found.proposed[-1] - found.disparity))
    minimum = config.proposals.min_second_distance - 1 / 3
    assert np.quantile(distance, 0.05) > minimum
    # The views agree best at the true disparity: over the whole aperture and its best half.
    for channel in (8, 9, 10, 11, 12):
        true, other = (np.median(found.costs.channels[k, channel][inner]) for k in (0, -1))
        assert true < 0.5 * other


def test_neighbours_continue_their_surface_up_to_an_edge_and_beyond(tolerance):
    y, x = np.mgrid[:20, :48].astype(np.float32)
    left, right = 0.5 + 0.02 * y - 0.05 * x, -1.0 - 0.03 * y - 0.04 * x
    disparity = jnp.asarray(np.where(x < 24, left, right))
    from_right, from_left = continued_surfaces(disparity, ((0, 3), (0, -3)), 8)
    np.testing.assert_allclose(from_right[:, 21:24], right[:, 21:24], **tolerance("absolute"))
    np.testing.assert_allclose(from_left[:, 24:27], left[:, 24:27], **tolerance("absolute"))
    peak = jnp.zeros((33, 33)).at[16, 16].set(1.0)  # the slopes on both sides differ in sign
    (continued,) = continued_surfaces(peak, ((0, 3),), 8)
    np.testing.assert_array_equal(continued[:, 13], peak[:, 16])


def test_neighbours_continue_their_surface_at_the_image_border(tolerance):
    y, x = np.mgrid[:24, :32].astype(np.float32)
    surface = 0.5 + 0.02 * y - 0.05 * x
    offsets = ((0, 4), (0, -4), (4, 0), (-10, 10))
    continued = np.asarray(continued_surfaces(jnp.asarray(surface), offsets, 8))
    for found, (down, right) in zip(continued, offsets, strict=True):
        # Outside the image, the nearest pixel inside is the neighbour.
        inner = np.s_[max(-down, 0) : 24 - max(down, 0), max(-right, 0) : 32 - max(right, 0)]
        np.testing.assert_allclose(found[inner], surface[inner], **tolerance("absolute"))


def test_second_best_is_the_least_cost_far_from_the_best():
    candidates = jnp.linspace(-2.0, 2.0, 9)
    costs = jnp.abs(candidates - 0.5).at[1].set(0.1)[:, None, None]  # a second minimum at -1.5
    searched = SearchResult(
        jnp.full((1, 1), 0.5), jnp.zeros_like(costs), costs, jax.nn.softmax(-costs, axis=0)
    )
    second = proposals.second_best(searched, candidates, 0.7)
    assert abs(float(second[0, 0]) + 1.5) <= 0.25  # half of the interval


def test_permuting_sectors_keeps_the_other_channels(random_proposals):
    costs, order = random_proposals(3, 4).costs, np.roll(np.arange(8), 3)
    permuted = costs.permute_sectors(order)
    np.testing.assert_array_equal(permuted.channels[:, 0], costs.channels[:, 5])
    np.testing.assert_array_equal(permuted.channels[:, 8:], costs.channels[:, 8:])


@pytest.mark.parametrize(
    ("offsets", "message"),
    [
        (((0, 1), (0, -1)), "transpositions"),
        (((0, 1), (1, 0)), "reflections"),
        (((0, 0),), "different from each other"),
        (((0, 1), (0, 1), (0, -1), (1, 0), (-1, 0)), "different from each other"),
    ],
)
def test_offsets_without_symmetry_are_refused(offsets, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(ProposalsConfig(), offsets=offsets)
