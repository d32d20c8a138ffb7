"""The learned selection among proposals."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.models import ProposalNet, preset
from occjax.models.proposal.selector import proposal_source_features

CONFIG = preset("proposal_small")


@functools.partial(jax.jit, static_argnames="config")
def select(variables, proposals, config=CONFIG):
    return ProposalNet(config).apply(variables, proposals, method="select")


def test_selection_depends_on_a_neighbourhood_of_about_a_hundred_pixels(
    variables, random_proposals
):
    assert len(preset("proposal").selector.context) == len(CONFIG.selector.context) == 4
    proposals = random_proposals(16, 160)
    changed = jax.tree.map(lambda maps: maps.at[..., 140:].multiply(0.5), proposals)
    before, after = (select(variables, each).probabilities for each in (proposals, changed))
    difference = np.abs(before - after).max((0, 1))
    assert difference[89] > 1e-5
    assert difference[:20].max() == 0


def test_order_of_the_neighbours_does_not_matter(variables, random_proposals, tolerance):
    """Only the first proposal, the refined disparity, and the last have a fixed place."""
    proposals = random_proposals(16, 16)
    order = np.array([0, 8, 3, 1, 2, 7, 5, 4, 6, 9])
    offsets = tuple(CONFIG.proposals.offsets[k - 1] for k in order[1:-1])
    reordered = dataclasses.replace(
        CONFIG, proposals=dataclasses.replace(CONFIG.proposals, offsets=offsets)
    )
    shuffled = proposals._replace(
        proposed=proposals.proposed[order],
        costs=type(proposals.costs)(proposals.costs.channels[order]),
    )
    expected = select(variables, proposals)
    found = select(variables, shuffled, config=reordered)
    np.testing.assert_allclose(
        found.probabilities, expected.probabilities[order], **tolerance("absolute")
    )
    np.testing.assert_allclose(found.disparity, expected.disparity, **tolerance("absolute"))
    mismatched = select(variables, shuffled)
    assert np.abs(mismatched.probabilities - expected.probabilities[order]).max() > 1e-3


def untrained(variables, initial_bias):
    """Return variables with zero score of all proposals but the first, as before training."""
    params = dict(variables["params"]["selector"])
    params["score"] = jax.tree.map(jnp.zeros_like, params["score"])
    params["stay"] = jnp.float32(initial_bias)
    return {"params": {"selector": params}}


def test_proposals_close_to_the_likeliest_are_averaged(variables, random_proposals, tolerance):
    """Without training, the scores are known: a bias of log 2 for the first proposal, else 0."""
    proposals = random_proposals(16, 16)
    change = 0.1 * jnp.round(10 * (proposals.proposed - proposals.disparity[None]))
    proposals = proposals._replace(proposed=proposals.disparity[None] + change)
    selection = select(untrained(variables, np.log(2)), proposals)
    np.testing.assert_allclose(selection.probabilities[0], 2 / 11, **tolerance("relative"))
    np.testing.assert_allclose(selection.probabilities[1:], 1 / 11, **tolerance("relative"))
    proposed = np.asarray(proposals.proposed)
    near = np.abs(proposed - proposed[0]) <= CONFIG.selector.window
    expected = np.average(proposed, axis=0, weights=near * np.asarray(selection.probabilities))
    np.testing.assert_allclose(selection.disparity, expected, **tolerance("absolute"))


def test_source_features_agree_with_loops(random_proposals, tolerance):
    proposals = random_proposals(9, 11)
    sources = ((0, 0), *CONFIG.proposals.offsets, (0, 0))
    found = proposal_source_features(proposals, sources, 0.05)
    centre, _, proposed, costs, variance, peak = map(np.asarray, jax.tree.leaves(proposals))

    def at(image, y, x):
        return np.float32(image[np.clip(y, 0, 8), np.clip(x, 0, 10)])

    for k, (down, right) in enumerate(sources):
        for y, x in ((4, 5), (0, 10), (8, 2)):
            steps = max(abs(down), abs(right))
            line = [
                at(centre, y + np.sign(down) * step, x + np.sign(right) * step)
                for step in range(steps + 1)
            ]
            difference, contrast = abs(line[-1] - line[0]), np.abs(np.diff(line)).sum()
            agreement = [1 / (1 + ((p - proposed[k, y, x]) / 0.05) ** 2) for p in proposed[:, y, x]]
            expected = [
                difference / (difference + 0.05),
                contrast / (contrast + 0.05),
                float(steps > 0),
                at(variance, y + down, x + right),
                at(peak, y + down, x + right),
                np.sqrt(at(costs[0, 9], y + down, x + right)),
                np.mean(agreement),
            ]
            np.testing.assert_allclose(found[k, :, y, x], expected, **tolerance("absolute"))


@pytest.mark.slow
def test_selector_learns_to_select_the_cheapest_proposal(variables, random_proposals):
    """Sixty steps of gradient descent on the log-likelihood of the proposal of least cost."""
    proposals = random_proposals(16, 16)
    cheapest = proposals.costs.best_half.argmin(0)[None]

    def loss(params):
        probabilities = select({"params": params}, proposals).probabilities
        return -jnp.log(jnp.take_along_axis(probabilities, cheapest, 0) + 1e-9).mean()

    @jax.jit
    def step(params):
        value, gradient = jax.value_and_grad(loss)(params)
        norm = jnp.sqrt(sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(gradient)))
        return jax.tree.map(lambda leaf, slope: leaf - 0.15 * slope / norm, params, gradient), value

    params, first = step(untrained(variables, 3.0)["params"])
    for _ in range(60):
        params, last = step(params)
    assert float(last) < 0.7 * float(first)
