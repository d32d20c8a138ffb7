import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from occjax import ops
from occjax.errors import InputError
from tests.ops.derivatives import assert_derivatives
from tests.reference import ops as reference

SIZE = (6, 7, 2)
OFFSET = np.array([1.0, -2.0], np.float32)
BORDERS = ("replicate", "zero")

shift = jax.jit(ops.shift)
warp = jax.jit(ops.warp, static_argnames="border")


def random(*shape, seed=0, scale=1.0):
    values = np.random.default_rng(seed).uniform(-scale, scale, shape)
    return values.astype(np.float32)


IMAGE = random(*SIZE)
DISPARITY = random(*SIZE[:2], seed=1, scale=3.0)
"""Times the offset, up to six pixels: well across every border."""


@pytest.mark.parametrize("disparity", [0.0, 0.3, -1.7, 2.0, -3.0, 3.4])
@pytest.mark.parametrize("offset", [(1.0, -2.0), (-0.6, 0.25), (0.0, 1.0)])
def test_shift_matches_the_loop(disparity, offset, tolerance):
    disparity, offset = np.float32(disparity), np.array(offset, np.float32)
    expected = reference.shift(IMAGE, disparity, offset)
    np.testing.assert_allclose(shift(IMAGE, disparity, offset), expected, **tolerance("float32"))


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("offset", [(1.0, -2.0), (-0.6, 0.25), (0.0, 0.0)])
def test_warp_matches_the_loop(border, offset, tolerance):
    offset = np.array(offset, np.float32)
    expected = reference.warp(IMAGE, DISPARITY, offset, border=border)
    actual = warp(IMAGE, DISPARITY, offset, border=border)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


@pytest.mark.parametrize("border", BORDERS)
def test_warp_at_whole_and_border_positions_matches_the_loop(border, tolerance):
    disparity = np.resize(np.arange(-4, 5, dtype=np.float32), SIZE[:2])
    expected = reference.warp(IMAGE, disparity, OFFSET, border=border)
    actual = warp(IMAGE, disparity, OFFSET, border=border)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


def test_rows_follow_the_row_offset_and_nearer_points_move_against_it():
    """A point at centre row 3 with disparity 1 is at row 2 of the view one step further down."""
    view_below = np.zeros(SIZE, np.float32)
    view_below[2, 4] = 1.0
    down = np.array([1.0, 0.0], np.float32)
    for registered in (
        shift(view_below, np.float32(1.0), down),
        warp(view_below, np.ones(SIZE[:2], np.float32), down),
    ):
        expected = np.zeros(SIZE)
        expected[3, 4] = 1.0
        np.testing.assert_array_equal(registered, expected)


@pytest.mark.parametrize("disparity", [6.0, 7.0, -7.0, 7.5, 60.0, -1e9, 1e30])
def test_shift_by_more_than_the_image_reads_only_zeros(disparity):
    both = np.array([1.0, -1.0], np.float32)
    assert not np.any(shift(IMAGE, np.float32(disparity), both))


@pytest.mark.parametrize("disparity", [6.0, -7.0, 60.5, -1e9, 1e30])
def test_warp_beyond_the_image_reads_the_corner_or_zero(disparity):
    both = np.array([1.0, -1.0], np.float32)
    everywhere = np.full(SIZE[:2], disparity, np.float32)
    corner = IMAGE[0, -1] if disparity > 0 else IMAGE[-1, 0]
    replicated = np.broadcast_to(corner, SIZE)
    np.testing.assert_array_equal(warp(IMAGE, everywhere, both), replicated)
    zero = warp(IMAGE, everywhere, both, border="zero")
    assert not np.any(zero)


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (5, 1), (2, 2)])
def test_images_of_one_or_two_pixels_match_the_loop(size, tolerance):
    image, disparity = random(*size, 1), random(*size, seed=1, scale=2.0)
    offset = np.array([1.0, -0.8], np.float32)
    for border in BORDERS:
        expected = reference.warp(image, disparity, offset, border=border)
        actual = warp(image, disparity, offset, border=border)
        np.testing.assert_allclose(actual, expected, **tolerance("float32"))
    for displacement in (0.0, 0.4, -1.3):
        actual = shift(image, np.float32(displacement), offset)
        expected = reference.shift(image, displacement, offset)
        np.testing.assert_allclose(actual, expected, **tolerance("float32"))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(0.0, 20.0), row=st.floats(-4.0, 4.0))
def test_warp_with_replicated_border_stays_within_the_values_of_the_image(seed, scale, row):
    disparity = random(*SIZE[:2], seed=seed, scale=scale)
    warped = np.asarray(warp(IMAGE, disparity, np.array([row, 1.0], np.float32)))
    assert np.all(warped <= IMAGE.max((0, 1)) + 1e-6)
    assert np.all(warped >= IMAGE.min((0, 1)) - 1e-6)


def test_strips_of_rows_are_the_rows_of_the_whole(tolerance):
    """The first row is traced: one compilation serves every strip."""
    shift_strip = jax.jit(lambda image, d, o, first: ops.shift(image, d, o, rows=(first, 2)))
    one = np.float32(1.3)
    shifted, warped = shift(IMAGE, one, OFFSET), warp(IMAGE, DISPARITY, OFFSET)
    for first in (0, 2, 4):
        rows = slice(first, first + 2)
        strip = shift_strip(IMAGE, one, OFFSET, first)
        np.testing.assert_allclose(strip, shifted[rows], **tolerance("float32"))
        strip = warp(IMAGE, DISPARITY[rows], OFFSET, first_row=first)
        np.testing.assert_allclose(strip, warped[rows], **tolerance("float32"))


@pytest.mark.parametrize("dtype", ["float32", "bfloat16", "float64"])
def test_every_dtype_is_kept_and_matches_the_loop(dtype, tolerance):
    with jax.enable_x64(dtype == "float64"):
        image, disparity = jnp.asarray(IMAGE, dtype), jnp.asarray(DISPARITY, dtype)
        offset = jnp.asarray(OFFSET)  # as view_offsets has it
        first_row = jnp.asarray(0)
        shifted = shift(image, disparity[0, 0], offset)
        expected = reference.shift(np.asarray(image), disparity[0, 0], OFFSET)
        assert shifted.dtype == dtype
        np.testing.assert_allclose(np.float64(shifted), expected, **tolerance(dtype))
        for border in BORDERS:
            warped = warp(image, disparity, offset, border=border, first_row=first_row)
            expected = reference.warp(np.asarray(image), disparity, OFFSET, border=border)
            assert warped.dtype == dtype
            np.testing.assert_allclose(np.float64(warped), expected, **tolerance(dtype))


def test_half_precision_disparity_does_not_round_coordinates():
    """Columns beyond 256 have no bfloat16 of their own: rounded, they would read a neighbour."""
    ramp = jnp.arange(400.0)[None, :, None]
    disparity = jnp.ones((1, 400), jnp.bfloat16)
    warped = warp(ramp, disparity, jnp.array([0.0, -1.0]))
    np.testing.assert_array_equal(warped[0, :-1, 0], np.arange(1.0, 400.0))


@pytest.mark.usefixtures("x64")
class TestDerivatives:
    offset = np.array([0.9, -1.15])

    def test_shift(self):
        assert_derivatives(ops.shift, random(4, 5, 2), np.float64(0.63), self.offset)

    @pytest.mark.parametrize("border", BORDERS)
    def test_warp(self, border):
        def function(image, disparity, offset):
            return ops.warp(image, disparity, offset, border=border)

        disparity = random(4, 5, seed=1, scale=2.0)
        assert_derivatives(function, random(4, 5, 2), disparity, self.offset)


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("whole", [0.0, 1.0, -1.0])
def test_derivative_at_whole_pixels_is_that_towards_larger_coordinates(border, whole, tolerance):
    """All of it, not the mean with the other side, and not half: zero is where training starts."""
    left = jnp.array([0.0, -1.0])  # larger disparity, larger coordinate
    disparity = jnp.full(SIZE[:2], whole)
    _, derivative = jax.jvp(
        lambda d: warp(IMAGE, d, left, border=border), (disparity,), (jnp.ones_like(disparity),)
    )
    here = reference.warp(IMAGE, disparity, left, border=border)
    beyond = reference.warp(IMAGE, disparity + 0.5, left, border=border)
    np.testing.assert_allclose(derivative, (beyond - here) / 0.5, **tolerance("float32"))


def test_shift_and_warp_have_the_same_derivative_at_whole_pixels(tolerance):
    left = jnp.array([0.0, -1.0])
    one = jnp.float32(1.0)
    _, of_shift = jax.jvp(lambda d: shift(IMAGE, d, left), (one,), (one,))
    here, beyond = (reference.shift(IMAGE, d, left) for d in (1.0, 1.5))
    np.testing.assert_allclose(of_shift, (beyond - here) / 0.5, **tolerance("float32"))


def test_the_gradient_of_a_shifted_image_scatters_nothing():
    """Sums in places known only while running are what a GPU is slow at."""

    def total(image, disparity):
        return jnp.square(shift(image, disparity, jnp.array([1.0, -2.0]))).sum()

    text = jax.jit(jax.grad(total)).lower(IMAGE, jnp.float32(0.3)).as_text()
    assert "dot_general" in text
    assert "scatter" not in text
    # Nor has a derivative in the disparity alone any matrix product.
    assert "dot_general" not in jax.jit(jax.grad(total, 1)).lower(IMAGE, 0.3).as_text()


def test_the_gradient_of_an_image_in_half_precision_is_summed_in_single():
    """A thousand points see the same pixel."""
    image = jnp.zeros((2, 1000, 1), jnp.bfloat16)
    place = -jnp.arange(1000, dtype=jnp.float32)[None].repeat(2, 0)

    def total(image):
        return warp(image, place, jnp.array([0.0, -1.0])).astype(jnp.float32).sum()

    # All look at the first pixel of their row.
    np.testing.assert_array_equal(jax.grad(total)(image)[:, 0, 0], [1000.0, 1000.0])


def test_vmap_is_a_loop_over_images(tolerance):
    images = np.stack([IMAGE, IMAGE[::-1]])
    disparities = np.stack([DISPARITY, DISPARITY[:, ::-1]])
    constants = np.array([0.4, -1.2], np.float32)
    offsets = np.stack([OFFSET, -OFFSET])
    warped = jax.jit(jax.vmap(ops.warp))(images, disparities, offsets)
    shifted = jax.jit(jax.vmap(ops.shift))(images, constants, offsets)
    for k in range(2):
        one = warp(images[k], disparities[k], offsets[k])
        np.testing.assert_allclose(warped[k], one, **tolerance("float32"))
        one = shift(images[k], constants[k], offsets[k])
        np.testing.assert_allclose(shifted[k], one, **tolerance("float32"))


def test_compiled_and_not_are_the_same(tolerance):
    image, disparity, offset = (jnp.asarray(each) for each in (IMAGE, DISPARITY, OFFSET))
    plain, compiled = ops.warp(image, disparity, offset), warp(image, disparity, offset)
    np.testing.assert_allclose(plain, compiled, **tolerance("float32"))


@pytest.mark.usefixtures("unchecked")
def test_an_unknown_border_is_an_error_not_a_replication():
    with pytest.raises(InputError, match='must be "replicate" or "zero", not "zeros"'):
        ops.warp(jnp.asarray(IMAGE), jnp.asarray(DISPARITY), jnp.asarray(OFFSET), border="zeros")
