"""Loss of the selection against NumPy loops, and training of the selector."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.samples import LightFieldSample
from occjax.errors import InputError
from occjax.models import preset, save_weights
from occjax.models.proposal import Selection
from occjax.models.proposal.residual import Residual, ResidualVolume
from occjax.training import (
    LossConfig,
    OptimiserConfig,
    TrainConfig,
    init_state,
    recipe,
    selection_errors,
    task_of,
    train_step,
)
from occjax.training.initial import initial_variables
from occjax.training.prepared import PreparedSample
from occjax.training.proposal import residual_errors
from tests.reference.variables import random_variables
from tests.training.conftest import PROPOSAL_NETWORK, prepared_batch

compute_errors = jax.jit(selection_errors, static_argnums=3)

CONFIG = LossConfig(penalty="log", width=0.05, distribution=1.0, settled=0.25)


@pytest.fixture(scope="module")
def selection():
    """A random selection among five proposals, and the true disparity."""
    generator = np.random.default_rng(2)
    scores = np.exp(generator.normal(size=(5, 4, 6)))
    proposed = generator.uniform(-0.4, 0.4, (5, 4, 6))
    proposed[:, 0, 0] = 0.1  # all accurate
    proposed[:, 0, 1] = 9.0  # all wrong
    truth = generator.uniform(-0.3, 0.3, (4, 6))
    truth[0, 0] = 0.1
    disparity = generator.uniform(-0.4, 0.4, (4, 6))
    arrays = (disparity, proposed, scores / scores.sum(0), truth)
    *fields, truth = (jnp.asarray(each, jnp.float32) for each in arrays)
    return Selection(*fields), truth


def test_errors_are_means_weighted_by_what_a_pixel_can_teach(selection, tolerance):
    """Loop over pixels: accuracy falls from 1 at an error of 0.04 to 0 at 0.12."""
    selection, truth = selection
    valid = np.ones((4, 6), bool)
    valid[2, 3] = False
    weights, penalties, entropies = [], [], []
    for place in zip(*np.nonzero(valid), strict=True):
        error = np.abs(np.asarray(selection.proposed)[:, *place] - truth[place])
        accuracy = np.interp(error, [0.04, 0.12], [1.0, 0.0])
        wrong = (error > 0.08).sum()
        weights.append(0.0 if wrong == 5 else 0.25 if wrong <= 1 else 1.0)
        off = abs(selection.disparity[place] - truth[place])
        penalties.append(0.25 * np.log1p(off / 0.05))
        probability = (np.asarray(selection.probabilities)[:, *place] * accuracy).sum()
        entropies.append(-np.log(max(probability / max(accuracy.max(), 1e-3), 1e-6)))
    assert set(weights) == {0.0, 0.25, 1.0}
    errors = compute_errors(selection, truth, jnp.asarray(valid), CONFIG)
    for name, values in (("disparity", penalties), ("distribution", entropies)):
        expected = np.average(values, weights=weights)
        np.testing.assert_allclose(errors[name].mean(), expected, **tolerance("relative"))
    bad = np.abs(selection.disparity - truth)[valid] > 0.07
    np.testing.assert_allclose(errors["badpix"].mean(), 100.0 * bad.mean(), **tolerance("relative"))


def test_probability_may_be_divided_among_accurate_proposals(tolerance):
    probabilities = jnp.array([0.5, 0.5, 0.0]).reshape(3, 1, 1)
    proposed = jnp.array([0.3, 0.33, 0.8]).reshape(3, 1, 1)
    truth = jnp.array([[0.3]])
    errors = compute_errors(
        Selection(truth, proposed, probabilities), truth, jnp.array([[True]]), CONFIG
    )
    np.testing.assert_allclose(errors["distribution"].mean(), 0.0, **tolerance("absolute"))


def test_unknown_disparities_leave_the_gradient_finite(selection):
    selection, truth = selection
    valid = jnp.arange(6)[None] > jnp.arange(4)[:, None]
    truth = jnp.where(valid, truth, jnp.nan)

    def loss(disparity, probabilities):
        changed = selection._replace(disparity=disparity, probabilities=probabilities)
        errors = compute_errors(changed, truth, valid, CONFIG)
        return errors["disparity"].mean() + errors["distribution"].mean()

    gradients = jax.jit(jax.grad(loss, (0, 1)))(selection.disparity, selection.probabilities)
    for gradient in gradients:
        assert np.isfinite(gradient).all()


@pytest.mark.slow
def test_the_selector_learns_to_select_the_proposal_of_low_cost(tolerance):
    optimiser = OptimiserConfig(peak_rate=1e-2, schedule="constant")
    config = TrainConfig(PROPOSAL_NETWORK, CONFIG, optimiser, steps=30)
    batch = prepared_batch()
    state, reports = init_state(config, batch), []
    for _ in range(30):
        state, metrics = train_step(state, batch, config=config)
        reports.append(metrics)
    first, last = reports[0], reports[-1]
    assert set(first) == {
        "applied",
        "badpix",
        "disparity",
        "distribution",
        "gradient_norm",
        "loss",
    }
    np.testing.assert_allclose(
        first["loss"], first["disparity"] + first["distribution"], **tolerance("relative")
    )
    assert first["badpix"] > 90.0  # the first proposal is selected, and is wrong
    assert last["badpix"] < 10.0
    assert last["loss"] < 0.2 * first["loss"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["proposal", "residual"])
def test_light_fields_are_trained_on_without_preparation(name):
    """Traced only, because compiling the search takes a minute."""
    config = recipe(name).train

    def like(*shape, dtype=jnp.float32):
        return jax.ShapeDtypeStruct(shape, dtype)

    def batch(size):
        return LightFieldSample(
            views=like(2, 1, 17, *size),
            offsets=like(2, 1, 17, 2),
            disparity=like(2, *size),
            visibility=like(2, 1, 17, *size, dtype=bool),
            valid=like(2, *size, dtype=bool),
        )

    state = jax.eval_shape(partial(init_state, config), batch((32, 48)))
    after, report = jax.eval_shape(partial(train_step, config=config), state, batch((32, 48)))
    assert jax.tree.map(jnp.shape, after) == jax.tree.map(jnp.shape, state)
    assert set(report) == {
        "applied",
        "badpix",
        "disparity",
        "distribution",
        "gradient_norm",
        "loss",
    }
    with pytest.raises(InputError, match="crop is 32x40 pixels; the network needs multiples of 16"):
        jax.eval_shape(partial(train_step, config=config), state, batch((32, 40)))


def test_variables_are_those_of_the_network():
    state = init_state(TrainConfig(PROPOSAL_NETWORK), prepared_batch(count=1))
    expected = random_variables(PROPOSAL_NETWORK)["params"]
    assert jax.tree.map(jnp.shape, state.params) == jax.tree.map(jnp.shape, expected)


def test_a_model_without_weights_is_refused():
    with pytest.raises(InputError, match="has no weights to train"):
        task_of(preset("photometric"))


def test_errors_of_a_residual_leave_out_pixels_beyond_its_reach(tolerance):
    generator = np.random.default_rng(0)
    disparity, truth = generator.uniform(-0.3, 0.3, (2, 5, 6))
    residual, confidence = generator.uniform(-0.1, 0.1, (5, 6)), generator.random((5, 6))
    valid = generator.random((5, 6)) > 0.2
    penalties, bad, entropies = [], [], []
    for place in np.argwhere(valid):
        y, x = place
        error = abs(disparity[y, x] + residual[y, x] - truth[y, x])
        bad.append(100.0 * (error > 0.07))
        entropies.append(-np.log(confidence[y, x] if error <= 0.07 else 1 - confidence[y, x]))
        if abs(disparity[y, x] - truth[y, x]) < 0.25:
            penalties.append(min(error, 0.1))
    assert 0 < len(penalties) < len(bad)
    errors = residual_errors(
        jnp.asarray(disparity, jnp.float32),
        Residual(*(jnp.asarray(each, jnp.float32) for each in (residual, confidence))),
        jnp.asarray(np.where(valid, truth, np.nan), jnp.float32),
        jnp.asarray(valid),
        reach=0.25,
        config=LossConfig(penalty="truncated", width=0.1),
    )
    np.testing.assert_allclose(
        errors["disparity"].mean(), np.mean(penalties), **tolerance("relative")
    )
    np.testing.assert_allclose(
        errors["distribution"].mean(), np.mean(entropies), **tolerance("float32")
    )
    np.testing.assert_allclose(errors["badpix"].mean(), np.mean(bad), **tolerance("relative"))


def volume_batch(count=2, size=(16, 16)):
    """Volumes whose cheapest candidate is correct: number 6, 0.06 above the disparity."""
    generator = np.random.default_rng(3)
    disparity = generator.uniform(-1.0, 1.0, (count, *size)).astype(np.float32)
    relative = np.ones((count, 4, 9, *size), np.float16)
    relative[:, :, 4], relative[:, :, 6] = 0.0, -1.0
    half = np.full(disparity.shape, 0.5, np.float16)
    packed = ResidualVolume(half, disparity, 0 * relative[:, :, 0], relative, half, half)
    return jax.tree.map(jnp.asarray, PreparedSample(packed, disparity + 0.06, half > 0))


def test_only_the_residual_is_trained_and_learns_the_cheapest_candidate():
    config = TrainConfig(
        PROPOSAL_NETWORK,
        LossConfig(penalty="truncated", width=0.1),
        OptimiserConfig(peak_rate=1e-2, schedule="constant", weight_decay=0.1),
        steps=15,
        trained="residual",
    )
    batch = volume_batch()
    first = state = init_state(config, batch)
    before = jax.tree.map(np.array, first.params)
    losses = []
    for _ in range(15):
        state, metrics = train_step(state, batch, config=config)
        losses.append(float(metrics["loss"]))
    np.testing.assert_allclose(losses[0], 0.06, atol=1e-6)  # untrained, the residual is zero
    assert losses[-1] < 0.02
    for params in (state.params, state.ema["params"]):
        jax.tree.map(np.testing.assert_array_equal, before["selector"], params["selector"])
    with pytest.raises(InputError, match="prepared for the other part"):
        train_step(init_state(config, batch), prepared_batch(), config=config)


def test_a_network_without_a_residual_cannot_train_it():
    for network in (preset("proposal", residual=None), preset("tiny")):
        with pytest.raises(InputError, match="no residual to train"):
            TrainConfig(network, trained="residual")


def test_initial_weights_without_a_residual_get_an_untrained_one(tmp_path):
    network = PROPOSAL_NETWORK
    selection_only = preset("proposal_small", selector=network.selector, residual=None)
    weights = {"params": {"selector": random_variables(network)["params"]["selector"]}}
    save_weights(tmp_path / "selection.safetensors", weights, selection_only)
    variables = initial_variables(network, tmp_path / "selection.safetensors")["params"]
    jax.tree.map(
        np.testing.assert_array_equal, variables["selector"], weights["params"]["selector"]
    )
    assert not np.any(variables["residual"]["score"]["kernel"])
    save_weights(tmp_path / "both.safetensors", {"params": variables}, network)
    again = initial_variables(network, tmp_path / "both.safetensors")["params"]
    jax.tree.map(np.testing.assert_array_equal, variables, again)
    with pytest.raises(InputError, match="another model"):
        initial_variables(preset("proposal"), tmp_path / "selection.safetensors")
