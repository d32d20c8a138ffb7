"""Sampling against NumPy loops, at borders, at whole pixels, and its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from occjax import ops
from occjax.errors import InputError
from tests.ops.arrays import random
from tests.ops.derivatives import assert_derivatives
from tests.reference import ops as reference

SIZE = (6, 7, 2)
OFFSET = np.array([1.0, -2.0], np.float32)
LEFT = np.array([0.0, -1.0], np.float32)
"""Offset of a view for which a larger disparity means a larger column."""

shift = jax.jit(ops.shift)
warp = jax.jit(ops.warp, static_argnames="border")

IMAGE = random(*SIZE)
DISPARITY = random(*SIZE[:2], seed=1, low=-3.0, high=3.0)
"""Times the offset, up to six pixels: beyond every border."""

borders = pytest.mark.parametrize("border", ["replicate", "zero"])


@pytest.mark.parametrize("disparity", [0.0, 0.3, -1.7, 2.0, -3.0, 3.4])
@pytest.mark.parametrize("offset", [(1.0, -2.0), (-0.6, 0.25), (0.0, 1.0)])
def test_shift_matches_loop(disparity, offset, tolerance):
    disparity, offset = np.float32(disparity), np.array(offset, np.float32)
    expected = reference.shift(IMAGE, disparity, offset)
    np.testing.assert_allclose(shift(IMAGE, disparity, offset), expected, **tolerance("float32"))


@borders
@pytest.mark.parametrize("offset", [(1.0, -2.0), (-0.6, 0.25), (0.0, 0.0)])
@pytest.mark.parametrize("whole", [False, True])
def test_warp_matches_loop(border, offset, whole, tolerance):
    offset = np.array(offset, np.float32)
    disparity = np.resize(np.arange(-4, 5), SIZE[:2]).astype(np.float32) if whole else DISPARITY
    expected = reference.warp(IMAGE, disparity, offset, border=border)
    actual = warp(IMAGE, disparity, offset, border=border)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


def test_rows_follow_the_row_offset_with_the_sign_of_the_convention():
    """A point at centre row 3 with disparity 1 is at row 2 of the view one step further down."""
    view_below = np.zeros(SIZE, np.float32)
    view_below[2, 4] = 1.0
    down = np.array([1.0, 0.0], np.float32)
    expected = np.zeros(SIZE)
    expected[3, 4] = 1.0
    np.testing.assert_array_equal(shift(view_below, np.float32(1.0), down), expected)
    np.testing.assert_array_equal(warp(view_below, np.ones(SIZE[:2], np.float32), down), expected)


@pytest.mark.parametrize("disparity", [7.0, -7.5, 60.0, -1e9, 1e30])
def test_beyond_the_image_shift_reads_zeros_and_warp_zeros_or_the_corner(disparity):
    both = np.array([1.0, -1.0], np.float32)
    assert not np.any(shift(IMAGE, np.float32(disparity), both))
    everywhere = np.full(SIZE[:2], disparity, np.float32)
    assert not np.any(warp(IMAGE, everywhere, both, border="zero"))
    corner = IMAGE[0, -1] if disparity > 0 else IMAGE[-1, 0]
    np.testing.assert_array_equal(warp(IMAGE, everywhere, both), np.broadcast_to(corner, SIZE))


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (5, 1), (2, 2)])
def test_images_of_one_or_two_pixels_match_loop(size, tolerance):
    image, disparity = random(*size, 1), random(*size, seed=1, low=-2.0, high=2.0)
    offset = np.array([1.0, -0.8], np.float32)
    for border in ("replicate", "zero"):
        expected = reference.warp(image, disparity, offset, border=border)
        actual = warp(image, disparity, offset, border=border)
        np.testing.assert_allclose(actual, expected, **tolerance("float32"))
    for displacement in (0.0, 0.4, -1.3):
        actual = shift(image, np.float32(displacement), offset)
        expected = reference.shift(image, displacement, offset)
        np.testing.assert_allclose(actual, expected, **tolerance("float32"))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(0.0, 20.0), row=st.floats(-4.0, 4.0))
def test_warp_with_replicated_border_stays_within_the_range_of_the_image(seed, scale, row):
    disparity = random(*SIZE[:2], seed=seed, low=-scale, high=scale)
    warped = np.asarray(warp(IMAGE, disparity, np.array([row, 1.0], np.float32)))
    assert np.all(warped <= IMAGE.max((0, 1)) + 1e-6)
    assert np.all(warped >= IMAGE.min((0, 1)) - 1e-6)


def test_strips_are_rows_of_the_whole(tolerance):
    """The first row is traced: one compiled program serves every strip."""
    shift_strip = jax.jit(lambda image, d, o, first: ops.shift(image, d, o, rows=(first, 2)))
    one = np.float32(1.3)
    shifted, warped = shift(IMAGE, one, OFFSET), warp(IMAGE, DISPARITY, OFFSET)
    for first in (0, 2, 4):
        rows = slice(first, first + 2)
        strip = shift_strip(IMAGE, one, OFFSET, first)
        np.testing.assert_allclose(strip, shifted[rows], **tolerance("float32"))
        strip = warp(IMAGE, DISPARITY[rows], OFFSET, first_row=first)
        np.testing.assert_allclose(strip, warped[rows], **tolerance("float32"))


@pytest.mark.parametrize("dtype", ["bfloat16", "float64"])
def test_dtype_is_kept_and_matches_loop(dtype, tolerance):
    with jax.enable_x64(dtype == "float64"):
        image, disparity = jnp.asarray(IMAGE, dtype), jnp.asarray(DISPARITY, dtype)
        first_row = jnp.asarray(0)
        shifted = shift(image, disparity[0, 0], OFFSET)
        expected = reference.shift(np.asarray(image), disparity[0, 0], OFFSET)
        assert shifted.dtype == dtype
        np.testing.assert_allclose(np.float64(shifted), expected, **tolerance(dtype))
        for border in ("replicate", "zero"):
            warped = warp(image, disparity, OFFSET, border=border, first_row=first_row)
            expected = reference.warp(np.asarray(image), disparity, OFFSET, border=border)
            assert warped.dtype == dtype
            np.testing.assert_allclose(np.float64(warped), expected, **tolerance(dtype))


def test_half_precision_disparity_does_not_round_coordinates():
    """Columns beyond 256 have no bfloat16 of their own; rounded, they would read a neighbour."""
    ramp = jnp.arange(400.0)[None, :, None]
    warped = warp(ramp, jnp.ones((1, 400), jnp.bfloat16), LEFT)
    np.testing.assert_array_equal(warped[0, :-1, 0], np.arange(1.0, 400.0))


@pytest.mark.usefixtures("x64")
class TestDerivatives:
    offset = np.array([0.9, -1.15])

    def test_shift(self):
        assert_derivatives(ops.shift, random(4, 5, 2), np.float64(0.63), self.offset)

    @borders
    def test_warp(self, border):
        def function(image, disparity, offset):
            return ops.warp(image, disparity, offset, border=border)

        disparity = random(4, 5, seed=1, low=-2.0, high=2.0)
        assert_derivatives(function, random(4, 5, 2), disparity, self.offset)


@borders
@pytest.mark.parametrize("whole", [0.0, 1.0, -1.0])
def test_derivative_at_whole_pixels_is_the_one_towards_larger_coordinates(border, whole, tolerance):
    """The full derivative, not the mean with the other side: training starts at zero."""
    disparity = jnp.full(SIZE[:2], whole)
    _, derivative = jax.jvp(
        lambda d: warp(IMAGE, d, LEFT, border=border), (disparity,), (jnp.ones_like(disparity),)
    )
    here, beyond = (
        reference.warp(IMAGE, disparity + step, LEFT, border=border) for step in (0.0, 0.5)
    )
    np.testing.assert_allclose(derivative, (beyond - here) / 0.5, **tolerance("float32"))
    if border == "zero":
        _, derivative = jax.jvp(
            lambda d: shift(IMAGE, d, LEFT), (jnp.float32(whole),), (jnp.float32(1.0),)
        )
        np.testing.assert_allclose(derivative, (beyond - here) / 0.5, **tolerance("float32"))


def test_gradient_of_a_half_precision_image_is_summed_in_single_precision():
    """A thousand points read the first pixel of their row; bfloat16 cannot count to 1000."""
    image = jnp.zeros((2, 1000, 1), jnp.bfloat16)
    disparity = -jnp.arange(1000, dtype=jnp.float32)[None].repeat(2, 0)

    def total(image):
        return warp(image, disparity, LEFT).astype(jnp.float32).sum()

    np.testing.assert_array_equal(jax.grad(total)(image)[:, 0, 0], [1000.0, 1000.0])


@pytest.mark.usefixtures("unchecked")
def test_unknown_border_is_refused():
    with pytest.raises(InputError, match="border is 'zeros'; did you mean 'zero'"):
        ops.warp(IMAGE, DISPARITY, OFFSET, border="zeros")
