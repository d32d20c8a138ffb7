"""Refocusing planes of known disparity, at the border, with weights, and its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from occjax.errors import InputError
from tests.ops.arrays import random
from tests.ops.derivatives import assert_derivatives
from tests.reference import ops as reference
from tests.scenes import plane

refocus, all_in_focus = jax.jit(ops.refocus), jax.jit(ops.all_in_focus)
VIEWS = random(3, 3, 6, 7, 2, low=0.0, high=1.0)
WEIGHTS = random(3, 3, seed=1, low=0.1, high=1.0)


def test_a_plane_is_sharp_at_its_disparity_and_blurred_at_another(tolerance):
    light_field = plane(disparity=2.0)  # whole pixels: no interpolation
    views = light_field.floating()
    np.testing.assert_allclose(refocus(views, 2.0), light_field.centre, **tolerance("absolute"))
    assert np.abs(refocus(views, 0.0) - light_field.centre).mean() > 0.05


def test_it_is_the_weighted_mean_of_shifted_views_by_loops(tolerance):
    offsets = random(3, 3, 2, seed=2, low=-1.5, high=1.5)
    total, weight = 0.0, 0.0
    for index in np.ndindex(3, 3):
        ones = np.ones((6, 7, 1), np.float32)
        disparity = np.float32(0.7)
        total += WEIGHTS[index] * reference.shift(VIEWS[index], disparity, offsets[index])
        weight += WEIGHTS[index] * reference.shift(ones, disparity, offsets[index])
    actual = refocus(VIEWS, 0.7, offsets=offsets, weights=WEIGHTS)
    np.testing.assert_allclose(actual, total / weight, **tolerance("float32"))


def test_missing_views_do_not_contribute_and_pixels_that_none_sees_are_zero():
    views, weights = VIEWS.copy(), np.zeros((3, 3), np.float32)
    weights[1, 0] = 2.0
    views[0] = 100.0
    image = refocus(views, 2.0, weights=weights)  # of one view two columns further left
    np.testing.assert_array_equal(image[:, :5], views[1, 0][:, 2:])
    assert not np.any(image[:, 5:])


def test_derivatives(x64):
    weights = WEIGHTS.astype(np.float64)
    # Not at whole pixels, not even the centre view.
    offsets = (1.1 * ops.view_offsets(3, 3) + 0.2).astype(np.float64)

    def function(views, disparity, offsets, weights):
        return ops.refocus(views, disparity, offsets=offsets, weights=weights)

    assert_derivatives(function, VIEWS, 0.37, offsets, weights)

    def everywhere(views, disparity, weights):
        return ops.all_in_focus(views, disparity, offsets=offsets, weights=weights)

    disparity = random(6, 7, seed=3, low=0.1, high=0.4)
    assert_derivatives(everywhere, 0.3 * VIEWS, disparity, weights)
    assert_derivatives(lambda d: ops.aperture_weights(offsets, d), 1.7)


def test_gradient_is_finite_where_no_view_contributes():
    def loss(disparity, diameter):
        weights = ops.aperture_weights(ops.view_offsets(3, 3), diameter)
        weights = weights * jnp.zeros((3, 3)).at[1, 0].set(1.0)
        return refocus(VIEWS, disparity, weights=weights).sum()

    gradients = jax.grad(loss, argnums=(0, 1))(jnp.float32(2.5), jnp.float32(1.5))
    assert np.isfinite(gradients).all()


@pytest.mark.parametrize(("diameter", "views"), [(0.0, 0.5), (1.0, 1.0), (3.0, 13 - 4 * 2**0.5)])
def test_the_aperture_is_round(diameter, views, tolerance):
    weights = ops.aperture_weights(ops.view_offsets(5, 5), diameter)
    np.testing.assert_allclose(float(weights.sum()), views, **tolerance("absolute"))
    np.testing.assert_array_equal(weights, weights.T[::-1])


def test_all_in_focus_is_the_centre_view_with_less_noise():
    light_field = plane(grid=(5, 5), disparity=1.0)  # whole pixels: no interpolation
    noise = np.random.default_rng(0).normal(0, 0.03, light_field.views.shape)
    image = all_in_focus(light_field.views + noise.astype(np.float32), light_field.ground_truth)
    inside = np.s_[2:-2, 2:-2]  # which all 25 views see
    error = (image - light_field.centre)[inside].std()
    assert 0.19 * 0.03 < error < 0.23 * 0.03


def test_all_in_focus_of_a_slanted_plane_is_sharp_where_one_focus_is_not():
    light_field = plane(grid=(5, 5), disparity=0.5, slope=(0.01, -0.04))
    sharp = all_in_focus(light_field.views, light_field.ground_truth)
    one_focus = refocus(light_field.views, 0.5)
    errors = [np.abs(image - light_field.centre).mean() for image in (sharp, one_focus)]
    assert errors[0] < 0.2 * errors[1]


def test_all_in_focus_leaves_out_views_in_which_a_point_is_hidden(tolerance):
    views = np.full((1, 3, 4, 8, 1), 0.2, np.float32)
    views[0, 2, :, 3] = 1.0
    image = all_in_focus(views, np.zeros((4, 8), np.float32))
    # The view differs by 0.8: weight 0.2 ** 2 among 1 + 1 + 0.04.
    expected = (0.2 * 2 + 0.04 * 1.0) / 2.04
    np.testing.assert_allclose(image[:, 3], expected, **tolerance("relative"))


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((VIEWS[0], 1.0), {}, r"must be \[v, u, h, w, c\]"),
        ((VIEWS, 1.0), {"weights": np.ones((2, 3))}, r"weights must be \[3, 3\]"),
        ((VIEWS, 1.0), {"offsets": np.ones((3, 3))}, r"offsets must be \[3, 3, 2\]"),
        ((VIEWS, np.ones((6, 7), np.float32)), {}, "disparity must be one number"),
    ],
)
def test_wrong_arguments_are_named(arguments, options, message, unchecked):
    with pytest.raises(InputError, match=message):
        ops.refocus(*arguments, **options)
