"""The training step: gradients over the batch, moving average, several devices, bfloat16."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from occjax.errors import InputError
from occjax.training import (
    LossConfig,
    TrainConfig,
    cascade_loss,
    init_state,
    task_of,
    train_step,
)
from occjax.training.placement import make_placement
from occjax.training.step import state_from_variables
from tests.reference.variables import random_variables
from tests.training.conftest import PROPOSAL_NETWORK, prepared_batch


def distance(one, other):
    """Return the largest difference between the leaves of two trees."""
    differences = jax.tree.map(lambda a, b: np.abs(np.asarray(a) - np.asarray(b)).max(), one, other)
    return max(jax.tree.leaves(differences))


def assert_close(one, other, **tolerance):
    """Check that the leaves of two trees agree."""
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, **tolerance), one, other)


def first_state(config):
    return state_from_variables(random_variables(config.network), config)


@pytest.fixture(scope="module")
def three_steps(six_steps, source):
    """Return the states before and after each of three steps, and the metrics of the steps."""
    state = first_state(six_steps)
    states, reports = [jax.device_get(state)], []
    for step in range(3):
        state, metrics = train_step(state, source(step), config=six_steps)
        states.append(jax.device_get(state))
        reports.append(jax.device_get(metrics))
    return states, reports


def test_steps_are_counted_and_change_every_parameter(three_steps):
    states, _ = three_steps
    assert [int(state.step) for state in states] == [0, 1, 2, 3]
    for before, after in zip(
        jax.tree.leaves(states[0].params), jax.tree.leaves(states[3].params), strict=True
    ):
        assert np.abs(before - after).max() > 0.0


def test_the_moving_average_is_that_of_the_states(three_steps, tolerance):
    """The decay is min(0.999, (1 + n) / (10 + n)), starting from the first weights."""
    states, _ = three_steps
    for name in ("params", "batch_stats"):
        mean = jax.tree.map(np.float64, getattr(states[0], name))
        for number, decay in enumerate((1 / 10, 2 / 11, 3 / 12)):
            latest = getattr(states[number + 1], name)
            mean = jax.tree.map(lambda m, x, d=decay: d * m + (1.0 - d) * x, mean, latest)
        assert_close(mean, states[3].ema[name], **tolerance("absolute"))
        assert distance(mean, getattr(states[3], name)) > 1e-4


@pytest.fixture(scope="module")
def differentiated(three_steps, six_steps, source):
    """Return a function from parameters to the loss of the third batch and its gradient."""
    states, _ = three_steps
    batch, task = source(2), task_of(six_steps.network)

    @jax.jit
    def function(params):
        def loss(params):
            outputs, statistics = task.apply(params, states[2].batch_stats, batch)
            errors = [jnp.abs(stage.disparity - batch.disparity).mean() for stage in outputs]
            return sum(errors), (outputs, statistics)

        return jax.value_and_grad(loss, has_aux=True)(params)

    return function


@pytest.mark.slow
def test_metrics_are_those_of_the_weights_before_the_step(
    three_steps, differentiated, six_steps, source, tolerance
):
    states, reports = three_steps
    (loss, (outputs, statistics)), gradient = differentiated(states[2].params)
    error = np.abs(np.asarray(outputs[-1].disparity - source(2).disparity))
    expected = {
        "loss": loss,
        "disparity_1": error.mean(),
        "badpix": 100.0 * (error > 0.07).mean(),
        "gradient_norm": norm(gradient),
    }
    for name, value in expected.items():
        np.testing.assert_allclose(reports[2][name], value, **tolerance("amplified"), err_msg=name)
    assert_close(statistics, states[3].batch_stats, **tolerance("convolution"))
    _, errors = cascade_loss(outputs, source(2), six_steps.loss)
    assert set(reports[2]) == {*errors, "loss", "badpix", "gradient_norm", "applied"}


@pytest.mark.slow
def test_the_gradient_is_that_of_the_loss_of_the_whole_batch(three_steps, differentiated):
    """A finite difference along the gradient equals its norm."""
    params = three_steps[0][2].params
    gradient = differentiated(params)[1]
    length = 1e-3 / norm(gradient)
    low, high = (
        differentiated(jax.tree.map(lambda p, g, s=sign: p + s * length * g, params, gradient))[0]
        for sign in (-1.0, 1.0)
    )
    np.testing.assert_allclose((high[0] - low[0]) / 2e-3, norm(gradient), rtol=0.05)


def norm(tree):
    """Return the Euclidean norm of all leaves together."""
    return np.sqrt(sum((np.asarray(leaf, np.float64) ** 2).sum() for leaf in jax.tree.leaves(tree)))


@pytest.mark.slow
@pytest.mark.skipif(jax.device_count() < 2, reason="there is one device")
def test_two_devices_with_a_sharded_state_compute_what_one_does(
    three_steps, six_steps, source, tolerance
):
    """``test_several_devices`` has devices that each hold the whole state."""
    placement = make_placement(2, devices=2, shard_state=True)
    state = placement.place_state(first_state(six_steps))
    batch = placement.place_batch(source(0))
    state, metrics = train_step(state, batch, config=six_steps, placement=placement)
    for array, sharding in zip(
        jax.tree.leaves(state), jax.tree.leaves(placement.state(state)), strict=True
    ):
        assert array.sharding.is_equivalent_to(sharding, array.ndim)
    states, reports = three_steps
    for name, value in reports[0].items():
        np.testing.assert_allclose(metrics[name], value, **tolerance("amplified"), err_msg=name)
    # Adam divides by the size of the gradient: if it is nearly zero, rounding decides the sign.
    assert_close(state.batch_stats, states[1].batch_stats, **tolerance("absolute"))
    first_moments = [one.opt_state[1][0].mu for one in (state, states[1])]
    assert_close(*first_moments, **tolerance("convolution"))


def test_a_batch_that_does_not_divide_is_refused_with_sizes_that_do():
    devices = jax.device_count()
    message = f"batch of {devices + 1} cannot be shared equally by {devices} devices; pass "
    with pytest.raises(InputError, match=f"{message}--data.batch-size {devices} or {2 * devices}"):
        make_placement(devices + 1)
    with pytest.raises(InputError, match="a multiple of 6"):
        make_placement(4, devices=1, accumulate=6)
    with pytest.raises(InputError, match="devices is 99, but there are"):
        make_placement(99, devices=99)


def test_a_sharded_state_is_divided_along_its_largest_axis_that_can_be():
    placement = make_placement(2, devices=2, shard_state=True)
    shapes = {"wide": (3, 4, 8), "odd": (3, 5), "first": (6, 4), "none": ()}
    state = {name: np.zeros(shape) for name, shape in shapes.items()}
    parts = {
        name: array.addressable_data(0).shape
        for name, array in placement.place_state(state).items()
    }
    assert parts == {"wide": (3, 4, 4), "odd": (3, 5), "first": (3, 4), "none": ()}


@pytest.mark.slow
def test_micro_batches_give_the_gradient_of_the_whole_batch(tolerance):
    """Without BatchNorm, and although the pixels that count differ from sample to sample."""
    config = TrainConfig(PROPOSAL_NETWORK, LossConfig(settled=0.2, distribution=0.3), steps=6)
    batch = prepared_batch(count=4)
    valid = np.arange(16) >= np.array([0, 4, 8, 12])[:, None, None]
    batch = batch._replace(valid=batch.valid & valid)
    results = [
        train_step(
            first_state(config), batch, config=dataclasses.replace(config, accumulate=accumulate)
        )
        for accumulate in (1, 2)
    ]
    for name, value in results[0][1].items():
        np.testing.assert_allclose(
            results[1][1][name], value, **tolerance("amplified"), err_msg=name
        )
    first_moments = [optax.tree.get(state.opt_state, "mu") for state, _ in results]
    assert distance(*first_moments) < 1e-5 * norm(first_moments[0])


@pytest.mark.slow
def test_the_statistics_of_micro_batches_are_averaged(three_steps, six_steps, source, tolerance):
    """Both micro-batches are the same: mean and variance are those of either."""
    batch = jax.tree.map(lambda field: jnp.repeat(field, 2, axis=0), source(0))
    config = dataclasses.replace(six_steps, accumulate=2)
    state, metrics = train_step(first_state(six_steps), batch, config=config)
    states, reports = three_steps
    np.testing.assert_allclose(metrics["loss"], reports[0]["loss"], **tolerance("amplified"))
    assert_close(state.batch_stats, states[1].batch_stats, **tolerance("convolution"))


@pytest.mark.slow
def test_rematerialisation_changes_nothing_but_memory(three_steps, six_steps, source, tolerance):
    config = dataclasses.replace(six_steps, rematerialise=True)
    state, metrics = train_step(first_state(six_steps), source(0), config=config)
    states, reports = three_steps
    np.testing.assert_allclose(metrics["loss"], reports[0]["loss"], **tolerance("float32"))
    first_moments = [one.opt_state[1][0].mu for one in (state, states[1])]
    assert_close(*first_moments, **tolerance("convolution"))


@pytest.mark.slow
@pytest.mark.parametrize("wrong", ["loss", "number"])
def test_a_refused_step_changes_nothing(three_steps, six_steps, source, wrong):
    """Its loss is not finite, or an earlier step was refused."""
    batch, number = source(0), 1
    if wrong == "loss":
        batch, number = batch._replace(views=batch.views * jnp.nan), 0
    state, metrics = train_step(
        first_state(six_steps), batch, number=np.int32(number), config=six_steps
    )
    assert not metrics["applied"]
    assert distance(state, three_steps[0][0]) == 0.0


@pytest.mark.slow
def test_bfloat16_keeps_float32_parameters_and_nearly_the_same_loss(three_steps, six_steps, source):
    half = dataclasses.replace(six_steps, precision="bfloat16")
    with jax.numpy_dtype_promotion("standard"):  # Flax's BatchNorm subtracts float32 statistics
        state, metrics = train_step(first_state(half), source(0), config=half)
    for tree in (state.params, state.ema, state.opt_state):
        assert {leaf.dtype for leaf in jax.tree.leaves(tree)} <= {
            jnp.dtype("float32"),
            jnp.dtype("int32"),
        }
    _, reports = three_steps
    np.testing.assert_allclose(metrics["loss"], reports[0]["loss"], rtol=0.05)
    assert metrics["loss"] != reports[0]["loss"]


def test_first_weights_are_a_function_of_the_seed(six_steps, source):
    one, same, other = (
        init_state(dataclasses.replace(six_steps, seed=seed), source(0)).params
        for seed in (0, 0, 1)
    )
    assert distance(one, same) == 0.0
    assert distance(one, other) > 0.1
