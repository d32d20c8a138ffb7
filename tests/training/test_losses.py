"""Losses against values worked out with NumPy, and their gradients against finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.samples import Sample
from occjax.errors import InputError
from occjax.models import StageOutput
from occjax.training import LossConfig, cascade_loss
from occjax.training.losses import (
    choice_error,
    choice_weight,
    distribution_error,
    inside_border,
    penalty,
    visibility_error,
)
from tests.ops.derivatives import assert_derivatives

COARSE = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
FINE = np.array([-0.5, 0.0, 0.5])


def random_probabilities(generator, *shape):
    scores = np.exp(generator.normal(size=shape))
    return scores / scores.sum(-3, keepdims=True)


def two_stages(seed=0, batch=2, size=(6, 8)):
    """Random outputs of a cascade of two stages, the second with occlusion maps, and a sample."""
    generator = np.random.default_rng(seed)

    def array(*shape, low=0.0, high=1.0):
        return jnp.asarray(generator.uniform(low, high, (batch, *shape)), jnp.float32)

    def stage(candidates, disparity, occlusion):
        return StageOutput(
            disparity=disparity,
            probabilities=jnp.asarray(
                random_probabilities(generator, batch, len(candidates), *size), jnp.float32
            ),
            candidates=jnp.tile(jnp.asarray(candidates, jnp.float32), (batch, 1)),
            attention=None,
            occlusion=occlusion,
        )

    sample = Sample(
        views=array(3, 3, *size),
        offsets=array(3, 3, 2),
        disparity=array(*size, low=-1.5, high=1.5),
        visibility=array(3, 3, *size) > 0.4,
        valid=array(*size) > 0.3,
    )
    near = sample.disparity + array(*size, low=-0.4, high=0.4)
    outputs = (
        stage(COARSE, near, None),
        stage(FINE, near + array(*size, low=-0.3, high=0.3), array(3, 3, *size)),
    )
    return outputs, sample


def split_over_neighbours(candidates, truth):
    """The distribution over candidates whose expectation is the truth, at most two not zero."""
    share = np.zeros(len(candidates))
    for index in range(len(candidates) - 1):
        low, high = candidates[index], candidates[index + 1]
        if low <= truth <= high:
            share[:] = 0.0
            share[index] = (high - truth) / (high - low)
            share[index + 1] = (truth - low) / (high - low)
    return share


def test_l1_is_the_sum_over_stages_of_the_mean_error():
    outputs, sample = two_stages()
    sample = sample._replace(valid=jnp.ones_like(sample.valid))
    loss, errors = cascade_loss(outputs, sample, LossConfig())
    means = [np.abs(np.asarray(stage.disparity - sample.disparity)).mean() for stage in outputs]
    np.testing.assert_allclose(loss, sum(means), rtol=1e-6)
    np.testing.assert_allclose([errors["disparity_0"], errors["disparity_1"]], means, rtol=1e-6)


def test_huber_is_quadratic_within_its_width_and_linear_beyond():
    error = jnp.array([0.0, 0.05, -0.1, 0.3, -2.0])
    expected = [0.0, 0.05**2 / 0.2, 0.05, 0.25, 1.95]
    np.testing.assert_allclose(penalty(error, kind="huber", width=0.1), expected, atol=1e-7)


def test_sharp_is_steepest_at_zero():
    error = jnp.array([0.0, 0.02, -0.02, 1.0])
    expected = [0.0, *[0.02 + 0.1 * np.log(2.0)] * 2, 1.0 + 0.1 * np.log(51.0)]
    np.testing.assert_allclose(penalty(error, kind="sharp", width=0.02), expected, rtol=1e-6)
    slope = jax.grad(lambda e: penalty(e, kind="sharp", width=0.02))
    np.testing.assert_allclose([slope(1e-7), slope(-1e-7), slope(1e3)], [6.0, -6.0, 1.0], rtol=1e-3)


def test_log_is_steep_at_zero_and_flat_far_away():
    error = jnp.array([0.0, 0.02, -0.02, 1.0])
    expected = [0.0, *[0.1 * np.log(2.0)] * 2, 0.1 * np.log(51.0)]
    np.testing.assert_allclose(penalty(error, kind="log", width=0.02), expected, rtol=1e-6)
    slope = jax.grad(lambda e: penalty(e, kind="log", width=0.02))
    np.testing.assert_allclose(
        [slope(1e-7), slope(-0.02), slope(4.98)], [5.0, -2.5, 0.02], rtol=1e-3
    )


def test_stage_weights_scale_whole_stages():
    outputs, sample = two_stages()
    config = LossConfig(stage_weights=(0.25, 2.0), distribution=0.5)
    loss, errors = cascade_loss(outputs, sample, config)
    expected = 0.25 * (errors["disparity_0"] + 0.5 * errors["distribution_0"])
    expected += 2.0 * (errors["disparity_1"] + 0.5 * errors["distribution_1"])
    np.testing.assert_allclose(loss, expected, rtol=1e-6)


def test_only_valid_pixels_inside_the_border_count():
    outputs, sample = two_stages()
    _, errors = cascade_loss(outputs, sample, LossConfig(border=2))
    counted = np.zeros(sample.valid.shape, bool)
    counted[:, 2:-2, 2:-2] = np.asarray(sample.valid)[:, 2:-2, 2:-2]
    error = np.abs(np.asarray(outputs[1].disparity - sample.disparity))
    np.testing.assert_allclose(errors["disparity_1"], error[counted].mean(), rtol=1e-6)


@pytest.mark.parametrize("border", [0, 1, 3])
def test_the_border_is_that_wide_on_each_side(border):
    inside = np.asarray(inside_border(jnp.ones((7, 9), bool), border))
    assert inside.sum() == (7 - 2 * border) * (9 - 2 * border)
    assert inside[3, border] == inside[border, 4] == inside[6 - border, 8 - border] == 1


def test_cross_entropy_is_that_of_the_truth_split_over_two_candidates():
    """Candidates that are not evenly spaced, truths on and between and beyond them."""
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
        share = split_over_neighbours(candidates, truth[place])
        assert abs((share * candidates).sum() - truth[place]) < 1e-12
        expected = -(share * np.log(probabilities[:, *place])).sum()
        np.testing.assert_allclose(entropy[place], expected, rtol=1e-5)


def test_the_distribution_of_a_refined_stage_is_relative_to_the_stage_before():
    outputs, sample = two_stages()
    config = LossConfig(distribution=1.0)
    _, errors = cascade_loss(outputs, sample, config)
    terms = []
    for item in np.ndindex(sample.valid.shape):
        residual = float(sample.disparity[item] - outputs[0].disparity[item])
        if sample.valid[item] and abs(residual) <= 0.5:
            share = split_over_neighbours(FINE, residual)
            probabilities = np.asarray(outputs[1].probabilities)[item[0], :, *item[1:]]
            terms.append(-(share * np.log(probabilities)).sum())
    assert 10 < len(terms) < sample.valid.size
    np.testing.assert_allclose(errors["distribution_1"], np.mean(terms), rtol=1e-5)


def test_a_stage_is_not_judged_by_the_distribution_of_the_next():
    """The disparity before is stopped: only its own error moves it."""
    outputs, sample = two_stages()

    def distribution(disparity):
        moved = (outputs[0]._replace(disparity=disparity), outputs[1])
        return cascade_loss(moved, sample, LossConfig(distribution=1.0))[1]["distribution_1"]

    assert np.abs(jax.grad(distribution)(outputs[0].disparity)).max() == 0.0
    assert distribution(outputs[0].disparity + 0.1) != distribution(outputs[0].disparity)


def test_a_choice_is_judged_by_the_probability_of_what_is_right():
    generator = np.random.default_rng(2)
    probabilities = random_probabilities(generator, 5, 4, 6)
    proposed = generator.uniform(-0.4, 0.4, (5, 4, 6))
    truth = generator.uniform(-0.3, 0.3, (4, 6))
    arguments = [jnp.asarray(each, jnp.float32) for each in (probabilities, proposed, truth)]
    entropy, weight = choice_error(*arguments), choice_weight(*arguments[1:], settled=0.25)
    for y, x in np.ndindex(4, 6):
        error = np.abs(proposed[:, y, x] - truth[y, x])
        right = np.interp(error, [0.04, 0.12], [1.0, 0.0])
        wrong = (error > 0.08).sum()
        assert weight[y, x] == (0.0 if wrong == 5 else 0.25 if wrong <= 1 else 1.0)
        if right.max() > 0.5:
            chosen = (right * probabilities[:, y, x]).sum() / right.max()
            np.testing.assert_allclose(entropy[y, x], -np.log(chosen), rtol=1e-4)
    assert set(np.unique(weight)) == {0.0, 1.0}
    same = jnp.broadcast_to(arguments[2], (5, 4, 6))
    assert set(np.unique(choice_weight(same, arguments[2], settled=0.25))) == {0.25}


def test_the_right_choice_costs_nothing_however_it_is_split():
    probabilities = jnp.array([0.5, 0.5, 0.0]).reshape(3, 1, 1)
    proposed = jnp.array([0.3, 0.33, 0.8]).reshape(3, 1, 1)
    entropy = choice_error(probabilities, proposed, jnp.array([[0.3]]))
    np.testing.assert_allclose(entropy, 0.0, atol=1e-6)


def test_a_choice_counts_where_there_is_one_to_learn():
    """Relative to the stage before; its disparity and its probabilities count alike."""
    outputs, sample = two_stages()
    generator = np.random.default_rng(4)
    away = sample.disparity - outputs[0].disparity
    proposed = away[:, None] + jnp.asarray(
        generator.choice([0.0, 0.02, 0.3, -0.5], outputs[1].probabilities.shape), jnp.float32
    )
    outputs = (outputs[0], outputs[1]._replace(candidates=proposed))
    config = LossConfig(distribution=1.0, settled=0.1)
    _, errors = cascade_loss(outputs, sample, config)
    weights, entropies = [], []
    for item in range(sample.valid.shape[0]):
        arguments = proposed[item], away[item]
        weights.append(jnp.where(sample.valid[item], choice_weight(*arguments, settled=0.1), 0.0))
        entropies.append(choice_error(outputs[1].probabilities[item], *arguments))
    assert len(np.unique(weights)) == 3
    error = jnp.abs(outputs[1].disparity - sample.disparity)
    for name, values in (("distribution_1", entropies), ("disparity_1", error)):
        expected = np.average(np.asarray(values), weights=np.asarray(weights))
        np.testing.assert_allclose(errors[name], expected, rtol=1e-5)
    _, everywhere = cascade_loss(outputs, sample, LossConfig())
    np.testing.assert_allclose(errors["disparity_0"], everywhere["disparity_0"])  # all of it


def test_occlusion_weights_are_judged_by_visibility():
    """The weight of a map M is (1 - M)^2; its cross-entropy with what each view sees."""
    outputs, sample = two_stages()
    _, errors = cascade_loss(outputs, sample, LossConfig(occlusion=1.0))
    assert "occlusion_0" not in errors
    maps = np.asarray(outputs[1].occlusion, np.float64)
    weight = np.clip((1.0 - maps) ** 2, 1e-4, 1.0 - 1e-4)
    entropy = np.where(sample.visibility, -np.log(weight), -np.log(1.0 - weight)).mean((1, 2))
    expected = entropy[np.asarray(sample.valid)].mean()
    np.testing.assert_allclose(errors["occlusion_1"], expected, rtol=1e-5)


@pytest.mark.parametrize(
    "config", [LossConfig(), LossConfig(penalty="huber", distribution=1.0, occlusion=1.0)]
)
def test_unknown_disparities_leave_loss_and_gradient_finite(config):
    """NaN where the truth is not known, and a batch without a single known pixel."""
    outputs, sample = two_stages()
    unknown = sample._replace(disparity=jnp.where(sample.valid, sample.disparity, jnp.nan))
    nothing = unknown._replace(valid=jnp.zeros_like(sample.valid))

    def loss(parts, sample):
        changed = [
            stage._replace(disparity=disparity, probabilities=probabilities)
            for stage, (disparity, probabilities) in zip(outputs, parts, strict=True)
        ]
        return cascade_loss(tuple(changed), sample, config)[0]

    parts = [(stage.disparity, stage.probabilities) for stage in outputs]
    expected = cascade_loss(outputs, sample, config)[0]
    np.testing.assert_allclose(loss(parts, unknown), expected, rtol=1e-6)
    assert loss(parts, nothing) == 0.0
    for case in (unknown, nothing):
        for gradient in jax.tree.leaves(jax.grad(loss)(parts, case)):
            assert np.isfinite(gradient).all()


def test_a_probability_of_zero_leaves_the_gradient_finite():
    probabilities = jnp.array([0.0, 1.0])[:, None, None]

    def entropy(probabilities):
        return distribution_error(probabilities, jnp.array([0.0, 1.0]), jnp.zeros((1, 1)))[0].sum()

    assert np.isfinite(entropy(probabilities))
    assert np.isfinite(jax.grad(entropy)(probabilities)).all()


@pytest.mark.usefixtures("x64")
def test_derivatives_of_the_penalties():
    error = np.array([-1.3, -0.07, 0.04, 0.6])
    assert_derivatives(lambda e: penalty(e, kind="l1"), error)
    assert_derivatives(lambda e: penalty(e, kind="huber", width=0.1), error)
    assert_derivatives(lambda e: penalty(e, kind="sharp", width=0.1), error)
    assert_derivatives(lambda e: penalty(e, kind="log", width=0.1), error)


@pytest.mark.usefixtures("x64")
def test_derivatives_of_the_cross_entropies():
    generator = np.random.default_rng(3)
    scores = generator.normal(size=(5, 4, 6))
    truth = generator.uniform(-1.9, 1.9, (4, 6))
    candidates = jnp.asarray(COARSE)

    def entropy(scores, truth):
        return distribution_error(jax.nn.softmax(scores, axis=0), candidates, truth)[0]

    assert_derivatives(entropy, scores, truth)
    weights = generator.uniform(0.1, 0.9, (3, 3, 4, 6))
    visibility = jnp.asarray(generator.uniform(size=weights.shape) > 0.5)
    assert_derivatives(lambda weights: visibility_error(weights, visibility), weights)


def test_as_many_stage_weights_as_outputs_are_needed():
    outputs, sample = two_stages()
    with pytest.raises(InputError, match="3 weights but the network 2 outputs"):
        cascade_loss(outputs, sample, LossConfig(stage_weights=(1.0, 1.0, 1.0)))
