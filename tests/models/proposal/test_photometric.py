"""The training-free estimator, ProposalNet without a selector, on scenes of known disparity."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.lightfield import to_grey, view_offsets
from occjax.models import ProposalNet, preset
from tests.io.scenes import two_planes
from tests.scenes import plane

SIZE, BORDER = (36, 36), 6
CANDIDATES = jnp.linspace(-2.0, 2.0, 33)
SLOPE = (0.01, -0.02)


@jax.jit
def compiled(views, candidates, offsets):
    network = ProposalNet(preset("photometric"))
    return network.apply({}, views, candidates=candidates, offsets=offsets)


def estimate(views, offsets=None):
    """Estimate from one list of views, so that a row and a column share a program."""
    offsets = view_offsets(*views.shape[:2]) if offsets is None else offsets
    views = views.reshape(1, -1, *views.shape[2:])
    return compiled(jnp.asarray(views), CANDIDATES, jnp.asarray(offsets).reshape(1, -1, 2))


def slanted(grid=(3, 3), disparity=0.3, slope=SLOPE):
    scene = plane(grid=grid, size=SIZE, disparity=disparity, slope=slope)
    return scene.grey(), scene.ground_truth


def square(grid=(3, 3)):
    """A square of disparity 1 in front of a wall of disparity -1."""
    views, truth = two_planes(grid, SIZE, far=-1.0, near=1.0)
    return to_grey(views), truth


def inner(image):
    return np.asarray(image)[..., BORDER:-BORDER, BORDER:-BORDER]


@pytest.mark.parametrize(
    ("grid", "mean", "largest"),
    # A row of views shows no disparity where the texture is constant along it.
    [((3, 3), 0.02, 0.2), ((1, 5), 0.03, 0.3), ((5, 1), 0.03, 0.3)],
)
def test_slanted_plane_is_recovered(grid, mean, largest):
    views, truth = slanted(grid)
    error = np.abs(inner(estimate(views).disparity - truth))
    assert error.mean() < mean
    assert error.max() < largest


def test_outline_of_a_square_is_preserved():
    views, truth = square((5, 5))
    error = np.abs(inner(estimate(views).disparity - truth))
    assert np.median(error) < 0.01
    # 68 of the 576 inner pixels are at the outline, where the disparity changes by 2.
    assert (error > 0.2).mean() < 68 / 576
    assert error.mean() < 0.15


def test_map_flips_with_rows_and_view_rows():
    views, _ = square()
    flipped = estimate(views[::-1, :, ::-1]).disparity
    np.testing.assert_allclose(flipped[::-1], estimate(views).disparity, atol=1e-3)


def test_map_transposes_with_images_and_grid():
    views, _ = slanted()
    difference = estimate(views.transpose(1, 0, 3, 2)).disparity.T - estimate(views).disparity
    # Planes are aggregated along columns first, then along rows.
    assert np.abs(inner(difference)).mean() < 0.01


def test_shear_of_the_views_is_added_to_the_disparity():
    maps = [estimate(slanted(disparity=disparity)[0]).disparity for disparity in (0.3, 0.8)]
    assert np.abs(inner(maps[1] - maps[0]) - 0.5).mean() < 0.03


def test_irregular_positions_are_used():
    half = np.float32([[-1.2, -0.8], [-0.9, 0.3], [-1.1, 1.2], [0.2, -1.1]])
    offsets = np.concatenate([half, [[0, 0]], -half[::-1]]).reshape(3, 3, 2).astype(np.float32)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float32)
    waves = np.random.default_rng(0).uniform(-0.8, 0.8, (12, 2))
    disparity = 0.6
    place = np.stack([y, x], -1) + disparity * offsets[:, :, None, None]
    views = 0.5 + 0.3 * np.sin(place @ waves.T + np.arange(12)).mean(-1).astype(np.float32)
    error = np.abs(inner(estimate(views, offsets).disparity - disparity))
    assert error.mean() < 0.02


def test_confidence_is_low_at_depth_edges():
    views, truth = square()
    found = estimate(views)
    edges = np.abs(np.diff(np.asarray(found.disparity), axis=1)) > np.ptp(truth) / 2
    assert edges.any()
    config = preset("photometric")
    at_reach = np.ptp(truth) / 2 / config.reach  # the views of this grid reach one step
    highest = config.confidence.edge_step / (config.confidence.edge_step + at_reach)
    assert found.confidence[:, 1:][edges].max() <= highest
    assert np.median(found.confidence) > highest


@pytest.mark.parametrize("gain", [1 / 16, 1 / 64])
def test_map_does_not_depend_on_exposure(gain, tolerance):
    views, _ = square()
    bright, dim = estimate(views), estimate(gain * views)
    np.testing.assert_allclose(dim.disparity, bright.disparity, **tolerance("float32"))
    np.testing.assert_allclose(dim.confidence, bright.confidence, **tolerance("float32"))


def test_noise_does_not_favour_candidates_between_pixels():
    """At disparity 1 all views are read at whole pixels; elsewhere interpolation averages noise."""
    views, truth = slanted((5, 5), disparity=1.0, slope=(0.0, 0.0))
    noise = np.random.default_rng(0).normal(0, 0.02, views.shape).astype(np.float32)
    searched = estimate(0.25 + views / 2 + noise).coarse
    assert np.abs(inner(searched - truth)).mean() < 0.045  # half an interval is 0.06


def test_vignetted_corners_continue_their_surroundings():
    views, truth = slanted(disparity=1.0, slope=(0.0, 0.0))
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    dark = x + y < 14
    disparity = estimate(np.where(dark, np.float32(0), views)).disparity
    np.testing.assert_allclose(disparity[dark], truth[dark], atol=0.2)


def test_confidence_is_high_on_texture_and_low_on_a_blank_wall(tolerance):
    views, _ = slanted()
    textured, blank = estimate(views), estimate(np.full_like(views, 0.5))
    assert inner(textured.confidence).min() > inner(blank.confidence).max()
    assert float(blank.confidence.max()) < 0.01
    assert float(textured.confidence.max()) <= 1.0
    # All candidates are equally likely: a uniform distribution over the range.
    np.testing.assert_allclose(blank.standard_deviation, CANDIDATES.std(), **tolerance("float32"))


@pytest.mark.slow
def test_gradients_are_finite_in_views_and_candidates():
    views = jnp.asarray(slanted((1, 3))[0][..., :8, :8])

    def total(views, candidates):
        output = ProposalNet(preset("photometric")).apply({}, views, candidates=candidates)
        return (output.disparity + output.confidence + output.standard_deviation).sum()

    gradients = jax.jit(jax.grad(total, argnums=(0, 1)))(views, jnp.linspace(-1.0, 1.0, 3))
    assert all(bool(jnp.isfinite(gradient).all()) for gradient in gradients)
    assert float(jnp.abs(gradients[0]).max()) > 0
