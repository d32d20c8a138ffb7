"""Loss of the cascade against NumPy loops, and the inputs of OccCasNet in training."""

import dataclasses
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.samples import LightFieldSample
from occjax.models import StageOutput
from occjax.training import LossConfig, cascade_loss, task_of
from occjax.training.occcasnet import distribution_error
from tests.ops.derivatives import assert_derivatives
from tests.reference.variables import random_variables
from tests.training.conftest import NETWORK

compute_loss = jax.jit(cascade_loss, static_argnums=2)

COARSE = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
FINE = np.array([-0.5, 0.0, 0.5])


def random_probabilities(generator, *shape):
    scores = np.exp(generator.normal(size=shape))
    return scores / scores.sum(-3, keepdims=True)


@pytest.fixture(scope="module")
def two_stages():
    """Random outputs of a cascade of two stages, and a batch in which some pixels are invalid."""
    generator = np.random.default_rng(0)
    batch, size = 2, (6, 8)

    def array(*shape, low=0.0, high=1.0):
        return jnp.asarray(generator.uniform(low, high, (batch, *shape)), jnp.float32)

    def stage(candidates, disparity):
        probabilities = random_probabilities(generator, batch, len(candidates), *size)
        return StageOutput(
            disparity=disparity,
            probabilities=jnp.asarray(probabilities, jnp.float32),
            candidates=jnp.tile(jnp.asarray(candidates, jnp.float32), (batch, 1)),
        )

    sample = LightFieldSample(
        views=array(3, 3, *size),
        offsets=array(3, 3, 2),
        disparity=array(*size, low=-1.5, high=1.5),
        visibility=array(3, 3, *size) > 0.4,
        valid=array(*size) > 0.3,
    )
    near = sample.disparity + array(*size, low=-0.4, high=0.4)
    return (stage(COARSE, near), stage(FINE, near + array(*size, low=-0.3, high=0.3))), sample


def split_over_neighbours(candidates, truth):
    """Return the distribution over the two candidates next to the truth with its expectation."""
    target = np.zeros(len(candidates))
    for index, (low, high) in enumerate(pairwise(candidates)):
        if low <= truth <= high:
            target[:] = 0.0
            target[index] = (high - truth) / (high - low)
            target[index + 1] = (truth - low) / (high - low)
    return target


@pytest.mark.parametrize("border", [0, 2])
def test_l1_is_the_sum_of_mean_errors_over_valid_pixels_inside_the_border(
    two_stages, border, tolerance
):
    outputs, sample = two_stages
    loss, errors = compute_loss(outputs, sample, LossConfig(border=border))
    counted = np.zeros(sample.valid.shape, bool)
    inside = np.s_[:, border : 6 - border, border : 8 - border]
    counted[inside] = np.asarray(sample.valid)[inside]
    means = [np.abs(each.disparity - sample.disparity)[counted].mean() for each in outputs]
    np.testing.assert_allclose(
        [errors["disparity_0"], errors["disparity_1"]], means, **tolerance("relative")
    )
    np.testing.assert_allclose(loss, sum(means), **tolerance("relative"))


def test_cross_entropy_is_that_of_the_truth_split_over_two_candidates(tolerance):
    """Candidates are not evenly spaced; truths lie on, between and beyond them."""
    generator = np.random.default_rng(1)
    candidates = np.array([-1.0, -0.25, 0.5, 2.0])
    truth = np.array([[-1.0, -0.9, -0.25, 0.1], [0.5, 1.9, 2.0, 2.2], [-1.1, 0.0, 1.0, 1.5]])
    probabilities = random_probabilities(generator, 4, 3, 4)
    entropy, covered = distribution_error(
        *(jnp.asarray(each, jnp.float32) for each in (probabilities, candidates, truth))
    )
    expected_covered = (truth >= -1.0) & (truth <= 2.0)
    np.testing.assert_array_equal(covered, expected_covered)
    for place in zip(*np.nonzero(expected_covered), strict=True):
        target = split_over_neighbours(candidates, truth[place])
        expected = -(target * np.log(probabilities[:, *place])).sum()
        np.testing.assert_allclose(entropy[place], expected, **tolerance("relative"))


def test_distribution_of_a_refined_stage_is_relative_to_the_stage_before(two_stages, tolerance):
    outputs, sample = two_stages
    loss, errors = compute_loss(outputs, sample, LossConfig(distribution=0.5))
    terms = []
    for item in np.ndindex(sample.valid.shape):
        residual = float(sample.disparity[item] - outputs[0].disparity[item])
        if sample.valid[item] and abs(residual) <= 0.5:
            target = split_over_neighbours(FINE, residual)
            probabilities = np.asarray(outputs[1].probabilities)[item[0], :, *item[1:]]
            terms.append(-(target * np.log(probabilities)).sum())
    assert 10 < len(terms) < sample.valid.size
    np.testing.assert_allclose(errors["distribution_1"], np.mean(terms), **tolerance("relative"))
    total = sum(errors[f"disparity_{n}"] + 0.5 * errors[f"distribution_{n}"] for n in (0, 1))
    np.testing.assert_allclose(loss, total, **tolerance("relative"))


def test_a_stage_gets_no_gradient_from_the_distribution_of_the_next(two_stages):
    outputs, sample = two_stages

    def distribution(disparity):
        moved = (outputs[0]._replace(disparity=disparity), outputs[1])
        return compute_loss(moved, sample, LossConfig(distribution=1.0))[1]["distribution_1"]

    assert np.abs(jax.grad(distribution)(outputs[0].disparity)).max() == 0.0
    assert distribution(outputs[0].disparity + 0.1) != distribution(outputs[0].disparity)


@pytest.mark.parametrize("config", [LossConfig(), LossConfig(penalty="log", distribution=1.0)])
def test_unknown_disparities_leave_loss_and_gradient_finite(two_stages, config, tolerance):
    """The truth is NaN where it is unknown; one batch has no valid pixel at all."""
    outputs, sample = two_stages
    unknown = sample._replace(disparity=jnp.where(sample.valid, sample.disparity, jnp.nan))
    nothing = unknown._replace(valid=jnp.zeros_like(sample.valid))

    @jax.jit
    def loss_and_gradient(parts, sample):
        return jax.value_and_grad(loss)(parts, sample)

    def loss(parts, sample):
        changed = [
            stage._replace(disparity=disparity, probabilities=probabilities)
            for stage, (disparity, probabilities) in zip(outputs, parts, strict=True)
        ]
        return compute_loss(tuple(changed), sample, config)[0]

    parts = [(stage.disparity, stage.probabilities) for stage in outputs]
    expected = compute_loss(outputs, sample, config)[0]
    for case, value in ((unknown, expected), (nothing, 0.0)):
        found, gradients = loss_and_gradient(parts, case)
        np.testing.assert_allclose(found, value, **tolerance("relative"))
        for gradient in jax.tree.leaves(gradients):
            assert np.isfinite(gradient).all()


def test_a_probability_of_zero_leaves_the_gradient_finite():
    def entropy(probabilities):
        return distribution_error(probabilities, jnp.array([0.0, 1.0]), jnp.zeros((1, 1)))[0].sum()

    value, gradient = jax.value_and_grad(entropy)(jnp.array([0.0, 1.0])[:, None, None])
    assert np.isfinite(value)
    assert np.isfinite(gradient).all()


@pytest.mark.usefixtures("x64")
def test_derivatives_of_the_cross_entropy():
    generator = np.random.default_rng(3)
    scores = generator.normal(size=(5, 4, 6))
    truth = generator.uniform(-1.9, 1.9, (4, 6))

    def entropy(scores, truth):
        return distribution_error(jax.nn.softmax(scores, axis=0), jnp.asarray(COARSE), truth)[0]

    assert_derivatives(entropy, scores, truth)


def test_networks_with_occlusion_from_the_ground_truth_receive_it_without_nan(source):
    coarse, refined = NETWORK.stages
    stages = (coarse, dataclasses.replace(refined, occlusion="ground_truth"))
    task = task_of(dataclasses.replace(NETWORK, stages=stages))
    variables, batch = random_variables(NETWORK), source(0)  # the variables are the same

    @jax.jit
    def maps(disparity, valid):
        samples = batch._replace(disparity=disparity, valid=valid)
        outputs, _ = task.apply(variables["params"], variables["batch_stats"], samples)
        return outputs[-1].occlusion

    true = maps(batch.disparity, batch.valid)
    assert np.abs(true).mean() < 0.05  # views agree if they are warped by the ground truth
    unknown = batch.valid.at[:, 3:5].set(False)
    partly = maps(jnp.where(unknown, batch.disparity, jnp.nan), unknown)
    assert np.isfinite(partly).all()
    np.testing.assert_array_equal(partly[..., 5:, :], true[..., 5:, :])
    assert np.abs(partly[..., 3:5, :] - true[..., 3:5, :]).max() > 0.05
