"""The training-free estimator on scenes whose disparity is known in closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.inference.photometric import photometric
from occjax.ops import view_offsets

HEIGHT, WIDTH, BORDER = 36, 44, 6
CANDIDATES = jnp.linspace(-2.0, 2.0, 33)
QUICK = {"xla_backend_optimization_level": 0}
"""Nearly all of the time is compilation, of which optimisation is half."""
compiled = jax.jit(photometric, static_argnames="config", compiler_options=QUICK)


def estimate(views, candidates, offsets=None):
    """With the offsets always an argument, regular and irregular grids share a compilation."""
    offsets = view_offsets(*views.shape[:2]) if offsets is None else offsets
    return compiled(views, candidates, offsets=offsets)


def _texture(y, x, seed=0):
    """``[..., 3]`` colours in [0, 1] at real coordinates: waves of 8 to 20 pixels."""
    rng = np.random.default_rng(seed)
    angle, length, phase = rng.uniform(0, [[2 * np.pi], [1.0], [2 * np.pi]], (3, 24))
    frequency = 2 * np.pi / (8.0 + 12.0 * length)
    along = y[..., None] * np.sin(angle) + x[..., None] * np.cos(angle)
    colour = np.sin(frequency * along + phase) @ rng.normal(0, 0.1, (24, 3))
    return np.clip(0.5 + colour, 0.0, 1.0)


def _grid(v, u):
    for row, column in np.ndindex(v, u):
        yield row, column, row - v // 2, column - u // 2


def _plane(v, u, disparity=0.3, slope=(0.01, -0.02), offsets=None):
    """Views of ``disparity + slope . (y, x)`` and that disparity ``[h, w]`` in the centre view."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    views = np.empty((v, u, HEIGHT, WIDTH, 3), np.float32)
    for row, column, down, right in _grid(v, u):
        if offsets is not None:
            down, right = offsets[row, column]
        # (y, x) of a view is centre pixel (y + d down, x + d right), where d obeys the plane.
        d = (disparity + slope[0] * y + slope[1] * x) / (1 - slope[0] * down - slope[1] * right)
        views[row, column] = _texture(y + d * down, x + d * right)
    return jnp.asarray(views), disparity + slope[0] * y + slope[1] * x


def _square(v, u, near=1.0, far=-1.0):
    """A square at disparity ``near`` before a background at ``far``, and its disparity."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    views = np.empty((v, u, HEIGHT, WIDTH, 3), np.float32)

    def inside(y, x):
        return (np.abs(y - 17.5) < 8) & (np.abs(x - 21.5) < 10)

    for row, column, down, right in _grid(v, u):
        foreground = y + near * down, x + near * right
        background = _texture(y + far * down, x + far * right, seed=1)
        views[row, column] = np.where(
            inside(*foreground)[..., None], _texture(*foreground), background
        )
    return jnp.asarray(views), np.where(inside(y, x), near, far)


def _inner(image):
    return np.asarray(image)[..., BORDER:-BORDER, BORDER:-BORDER]


@pytest.mark.parametrize(
    ("grid", "mean", "largest"),
    # One row of views knows nothing where the texture runs along it.
    [((9, 9), 0.02, 0.15), ((3, 3), 0.02, 0.2), ((1, 5), 0.03, 0.3), ((5, 1), 0.03, 0.3)],
)
def test_a_slanted_textured_plane_is_recovered(grid, mean, largest):
    views, truth = _plane(*grid)
    error = np.abs(_inner(estimate(views, CANDIDATES).disparity - truth))
    assert error.mean() < mean
    assert error.max() < largest


def test_irregular_positions_are_taken_into_account():
    offsets = np.float32([[[-1.2, -0.8], [-0.9, 0.3], [-1.1, 1.2]]])
    offsets = np.concatenate([offsets, [[[0.2, -1.1], [0, 0], [-0.2, 0.9]]], -offsets]).astype("f4")
    views, truth = _plane(3, 3, offsets=offsets)
    error = np.abs(
        _inner(estimate(views, CANDIDATES, offsets=jnp.asarray(offsets)).disparity - truth)
    )
    assert error.mean() < 0.02


def test_a_square_before_a_background_keeps_its_outline():
    views, truth = _square(9, 9)
    error = np.abs(_inner(estimate(views, CANDIDATES).disparity - truth))
    assert np.median(error) < 0.01
    # 64 of the 768 inner pixels touch the outline; the step across it is 2.
    assert (error > 0.2).mean() < 64 / 768
    assert error.mean() < 0.15


def test_the_map_flips_with_rows_and_view_rows():
    views, _ = _square(3, 3)
    disparity = estimate(views, CANDIDATES).disparity
    flipped = estimate(views[::-1, :, ::-1], CANDIDATES).disparity
    np.testing.assert_allclose(flipped[::-1], disparity, atol=1e-3)


def test_the_map_transposes_with_images_and_grid():
    views = _plane(3, 3)[0][..., :HEIGHT, :]
    transposed = views.transpose(1, 0, 3, 2, 4)
    difference = (
        estimate(transposed, CANDIDATES).disparity.T - estimate(views, CANDIDATES).disparity
    )
    # Planes are grown along columns, then rows: the order leaves a trace.
    assert np.abs(_inner(difference)).mean() < 0.01


def test_shearing_the_views_adds_to_the_disparity():
    views, _ = _plane(3, 3)
    sheared, _ = _plane(3, 3, disparity=0.3 + 0.5)
    added = estimate(sheared, CANDIDATES).disparity - estimate(views, CANDIDATES).disparity
    assert np.abs(_inner(added) - 0.5).mean() < 0.02


def test_a_batch_of_grey_scenes_gives_the_maps_of_the_coloured_ones():
    scenes = jnp.stack([_plane(3, 3)[0], _square(3, 3)[0]])
    grey = scenes @ jnp.array([0.299, 0.587, 0.114])
    batch = jax.jit(jax.vmap(photometric, in_axes=(0, None)), compiler_options=QUICK)(
        grey[..., None], CANDIDATES
    )
    for index, scene in enumerate(scenes):
        single = estimate(scene, CANDIDATES)
        np.testing.assert_allclose(batch.disparity[index], single.disparity, atol=1e-3)
        np.testing.assert_allclose(batch.confidence[index], single.confidence, atol=1e-4)


@pytest.mark.parametrize("gain", [1 / 16, 1 / 64])
def test_the_map_does_not_depend_on_exposure(gain):
    views, _ = _square(3, 3)
    bright, dim = estimate(views, CANDIDATES), estimate(gain * views, CANDIDATES)
    np.testing.assert_allclose(dim.disparity, bright.disparity, atol=1e-3)
    np.testing.assert_allclose(dim.confidence, bright.confidence, atol=1e-4)


def test_occlusion_maps_stay_in_the_unit_of_the_views():
    views, _ = _square(3, 3)
    bright, dim = estimate(views, CANDIDATES), estimate(views / 16, CANDIDATES)
    np.testing.assert_allclose(16 * dim.occlusion, bright.occlusion, atol=2e-3)


def test_noise_does_not_draw_the_map_to_candidates_between_pixels():
    """At disparity 1 all views are read at whole pixels; beside it interpolation averages noise."""
    views, truth = _plane(9, 9, disparity=1.0, slope=(0.0, 0.0))
    noise = np.random.default_rng(0).normal(0, 0.02, views.shape).astype(np.float32)
    coarse = estimate(0.25 + views / 2 + noise, CANDIDATES).coarse
    # Half a spacing is 0.06; left to the noise the error is 0.076.
    assert np.abs(_inner(coarse - truth)).mean() < 0.02


def test_vignetted_corners_continue_their_surroundings():
    views, truth = _plane(3, 3, disparity=1.0, slope=(0.0, 0.0))
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    seen = (x + y >= 14)[..., None]
    disparity = estimate(jnp.where(seen, views, 0.0), CANDIDATES).disparity
    np.testing.assert_allclose(disparity[~seen[..., 0]], truth[~seen[..., 0]], atol=0.2)


def test_confidence_is_high_on_texture_and_low_on_a_blank_wall():
    views, _ = _plane(3, 3)
    blank = jnp.full_like(views, 0.5)
    textured, untextured = estimate(views, CANDIDATES), estimate(blank, CANDIDATES)
    assert _inner(textured.confidence).min() > _inner(untextured.confidence).max()
    assert float(untextured.confidence.max()) < 0.01
    assert float(textured.confidence.max()) <= 1.0
    # Candidates that are all alike spread like a uniform distribution over the range.
    np.testing.assert_allclose(untextured.standard_deviation, CANDIDATES.std(), rtol=1e-3)


def test_occlusion_maps_show_the_background_that_the_square_hides():
    views, _ = _square(9, 9)
    occlusion = np.asarray(estimate(views, CANDIDATES).occlusion)
    # In the last view column the square moves 4 pixels left before a background moving 4 right.
    hidden, visible = occlusion[4, 8, 12:24, 5:9], occlusion[4, 8, 12:24, 35:38]
    assert hidden.mean() > 5 * visible.mean()
    np.testing.assert_array_equal(occlusion[4, 4], 0.0)


def test_gradients_are_finite_in_views_and_candidates():
    views = _plane(1, 3)[0][:, :, :12, :14]
    candidates = jnp.linspace(-1.0, 1.0, 5)

    def total(views, candidates):
        result = photometric(views, candidates)
        return (result.disparity + result.confidence + result.standard_deviation).sum()

    gradients = jax.jit(jax.grad(total, argnums=(0, 1)), compiler_options=QUICK)(views, candidates)
    assert all(bool(jnp.isfinite(gradient).all()) for gradient in gradients)
    assert float(jnp.abs(gradients[0]).max()) > 0


@pytest.mark.parametrize(
    ("views", "candidates", "message"),
    [
        ((1, 1, 8, 8, 3), 5, "at least 1x2"),
        ((3, 3, 8, 8, 3), 2, "at least 3 candidates"),
        ((3, 3, 1, 8, 3), 5, "at least 3x3 pixels.*1x8"),
        ((3, 3, 8, 2, 3), 5, "at least 3x3 pixels.*8x2"),
    ],
)
def test_what_cannot_be_estimated_is_an_input_error(views, candidates, message):
    with pytest.raises(InputError, match=message):
        photometric(jnp.zeros(views), jnp.linspace(-1.0, 1.0, candidates))


def test_the_order_of_the_candidates_does_not_matter():
    views, _ = _plane(3, 3)
    forwards, backwards = estimate(views, CANDIDATES), estimate(views, CANDIDATES[::-1])
    np.testing.assert_array_equal(forwards.disparity, backwards.disparity)


@pytest.mark.parametrize(
    ("views", "message"),
    [
        (np.zeros((3, 3, 8, 8, 3), np.uint8), "must be floating point, not uint8"),
        (np.zeros((3, 3, 8, 8, 4), np.float32), "not 4 channels"),
    ],
)
def test_views_of_another_kind_are_refused(views, message):
    unchecked = photometric.__wrapped__  # here the type checker would refuse them before
    with pytest.raises(InputError, match=message):
        unchecked(views, CANDIDATES)
