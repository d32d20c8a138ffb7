"""Penalties and counted pixels, in closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.training import LossConfig
from occjax.training.losses import bad_pixels, inside_border, penalty, weighted_sum
from tests.ops.derivatives import assert_derivatives


def test_log_penalty_is_steep_at_zero_and_flat_far_away(tolerance):
    error = jnp.array([0.0, 0.02, -0.02, 1.0])
    expected = [0.0, *[0.1 * np.log(2.0)] * 2, 0.1 * np.log(51.0)]
    values = penalty(error, kind="log", width=0.02)
    np.testing.assert_allclose(values, expected, **tolerance("float32"))
    slope = jax.grad(lambda e: penalty(e, kind="log", width=0.02))
    slopes = [slope(1e-7), slope(-0.02), slope(4.98)]
    np.testing.assert_allclose(slopes, [5.0, -2.5, 0.02], **tolerance("float32"))


def test_truncated_penalty_is_constant_above_its_width(tolerance):
    values = penalty(jnp.array([0.03, -0.04, 0.1, -7.0]), kind="truncated", width=0.1)
    np.testing.assert_allclose(values, [0.03, 0.04, 0.1, 0.1], **tolerance("float32"))


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("kind", ["l1", "log", "truncated"])
def test_derivatives_of_the_penalties(kind):
    error = np.array([-1.3, -0.07, 0.04, 0.6])
    assert_derivatives(lambda e: penalty(e, kind=kind, width=0.1), error)


@pytest.mark.parametrize("border", [0, 1, 3])
def test_border_has_its_width_on_each_side(border):
    inside = np.asarray(inside_border(jnp.ones((7, 9), bool), border))
    expected = np.zeros((7, 9), bool)
    expected[border : 7 - border, border : 9 - border] = True
    np.testing.assert_array_equal(inside, expected)


def test_weighted_mean_ignores_nan_of_weight_zero():
    values = jnp.array([[1.0, jnp.nan, 4.0]])
    assert weighted_sum(values, jnp.array([[1.0, 0.0, 0.5]])).mean() == 2.0
    assert weighted_sum(values, jnp.zeros((1, 3))).mean() == 0.0


def test_bad_pixels_are_a_percentage_of_the_valid_pixels(tolerance):
    truth = jnp.zeros((1, 4))
    disparity = jnp.array([[0.06, -0.08, 5.0, 0.0]])
    valid = jnp.array([[True, True, False, True]])
    np.testing.assert_allclose(
        bad_pixels(disparity, truth, valid, 0).mean(), 100 / 3, **tolerance("relative")
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"width": 0.0}, "loss.width is 0.0; pass more than 0"),
        ({"border": -1}, "loss.border is -1; pass 0 or more"),
        ({"accurate_error": 0.2}, "loss.wrong_error is 0.12; it must be greater"),
    ],
)
def test_meaningless_settings_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        LossConfig(**options)
