"""Learning rates in closed form, and the optimiser against AdamW in NumPy."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from occjax.training import OptimiserConfig, learning_rate, make_optimiser


def test_published_rate_is_halved_at_floor_of_epoch_plus_one_over_thirty(tolerance):
    rate = learning_rate(OptimiserConfig(schedule="halving", peak_rate=1e-3), 120 * 4000)
    for epoch in range(120):
        expected = 1e-3 * 0.5 ** math.floor((epoch + 1) / 30)
        for step in (4000 * epoch, 4000 * epoch + 3999):
            np.testing.assert_allclose(rate(step), expected, **tolerance("relative"))


def test_cosine_rises_linearly_and_ends_at_its_final_fraction(tolerance):
    config = OptimiserConfig(peak_rate=2e-3, warm_up=10, final_fraction=0.1)
    rate = learning_rate(config, 111)
    np.testing.assert_allclose(
        [rate(0), rate(4), rate(9)], [2e-4, 1e-3, 2e-3], **tolerance("relative")
    )
    for step in (10, 35, 60, 110):
        wave = 0.5 * (1.0 + math.cos(math.pi * (step - 10) / 100))
        np.testing.assert_allclose(rate(step), 2e-3 * (0.1 + 0.9 * wave), **tolerance("relative"))
    np.testing.assert_allclose(rate(110), 2e-4, **tolerance("relative"))


def test_rate_is_constant_after_the_warm_up():
    rate = learning_rate(OptimiserConfig(schedule="constant", peak_rate=0.5, warm_up=4), 100)
    np.testing.assert_allclose([rate(1), rate(3), rate(99)], [0.25, 0.5, 0.5])


def test_halving_counts_epochs_from_the_first_step_of_the_warm_up(tolerance):
    config = OptimiserConfig(schedule="halving", warm_up=3, epoch_steps=4, halving_epochs=2)
    rate = learning_rate(config, 30)
    for step in range(30):
        expected = 1e-3 * 0.5 ** ((step // 4 + 1) // 2) if step >= 3 else 1e-3 * (step + 1) / 3
        np.testing.assert_allclose(rate(step), expected, **tolerance("relative"))


@pytest.mark.parametrize("clip", [None, 1.0])
def test_updates_are_those_of_clipped_adamw(clip, tolerance):
    """Only the kernel decays; clipping uses the norm of both parameters together."""
    config = OptimiserConfig(
        peak_rate=0.1, schedule="constant", warm_up=2, weight_decay=0.2, clip=clip
    )
    optimiser = make_optimiser(config, 10)
    generator = np.random.default_rng(0)
    params = {"kernel": generator.normal(size=(2, 3)), "bias": generator.normal(size=3)}
    ours = {name: jnp.asarray(value, jnp.float32) for name, value in params.items()}
    state = optimiser.init(ours)
    first = dict.fromkeys(params, 0.0)
    second = dict.fromkeys(params, 0.0)
    for step, size in enumerate((5.0, 0.3, 0.01)):
        gradients = {name: size * generator.normal(size=params[name].shape) for name in params}
        norm = math.sqrt(sum((gradient**2).sum() for gradient in gradients.values()))
        scale = min(1.0, clip / norm) if clip else 1.0
        rate = 0.1 * min((step + 1) / 2, 1.0)
        for name in params:
            gradient = scale * gradients[name]
            first[name] = 0.9 * first[name] + 0.1 * gradient
            second[name] = 0.999 * second[name] + 0.001 * gradient**2
            mean = first[name] / (1.0 - 0.9 ** (step + 1))
            variance = second[name] / (1.0 - 0.999 ** (step + 1))
            decay = 0.2 * params[name] if name == "kernel" else 0.0
            params[name] = params[name] - rate * (mean / (np.sqrt(variance) + 1e-8) + decay)
        given = {name: jnp.asarray(value, jnp.float32) for name, value in gradients.items()}
        with jax.numpy_dtype_promotion("standard"):  # as in the step
            updates, state = optimiser.update(given, state, ours)
        ours = optax.apply_updates(ours, updates)
    for name in params:
        np.testing.assert_allclose(ours[name], params[name], **tolerance("float32"))


@pytest.mark.parametrize("clip", [None, 1.0])
def test_frozen_modules_keep_their_parameters(clip, tolerance):
    """The others change as if they were alone, with weight decay and clipping."""
    config = OptimiserConfig(peak_rate=0.1, schedule="constant", weight_decay=0.2, clip=clip)
    params = {name: {"kernel": jnp.full((2, 2), 3.0)} for name in ("selector", "residual")}
    gradients = jax.tree.map(lambda kernel: 0.1 * kernel, params)

    def updates(optimiser, params, gradients):
        with jax.numpy_dtype_promotion("standard"):  # as in the step
            return optimiser.update(gradients, optimiser.init(params), params)[0]

    frozen = updates(make_optimiser(config, 10, frozen=("selector",)), params, gradients)
    alone = updates(
        make_optimiser(config, 10),
        {"residual": params["residual"]},
        {"residual": gradients["residual"]},
    )
    np.testing.assert_array_equal(frozen["selector"]["kernel"], 0.0)
    np.testing.assert_allclose(
        frozen["residual"]["kernel"], alone["residual"]["kernel"], **tolerance("float32")
    )
