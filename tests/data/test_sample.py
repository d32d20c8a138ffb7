"""The bundled sample is what its recipe renders, and is photo-consistent with its ground truth."""

import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.procedural import centre_disparity, render_rows, view_visibility
from occjax.data.sample import (
    GRID,
    IMAGE_SIZE,
    SAMPLES,
    calibration,
    sample,
    tile,
    untile,
    write_sample,
)
from occjax.data.still_life import PERSPECTIVE, RELIEF, still_life
from occjax.lightfield import GREY_WEIGHTS
from occjax.ops.geometry import view_offsets

ROWS = np.arange(90, 180, 30)


@pytest.fixture(scope="module")
def scene():
    return still_life()


@pytest.fixture(scope="module")
def light_field():
    return sample()


def test_the_sample_is_a_whole_light_field(light_field):
    assert light_field.grid == (9, 9)
    assert light_field.image_size == (256, 256)
    assert light_field.views.dtype == np.uint8
    truth = light_field.ground_truth
    assert np.isfinite(truth).all()
    lowest, highest = light_field.disparity_range
    assert lowest <= truth.min() < -1.0
    assert 2.0 < truth.max() <= highest


@pytest.mark.parametrize("view", [(0, 8), (4, 4)])
def test_the_bundled_views_are_what_the_recipe_renders(scene, light_field, view):
    rendered = render_rows(
        scene, view_offsets(*GRID)[view], jnp.asarray(ROWS), IMAGE_SIZE, samples=SAMPLES
    )
    difference = np.asarray(rendered) * 255.0 - light_field.views[view][ROWS]
    grey = np.abs(difference @ np.array(GREY_WEIGHTS))
    # The bundled views are JPEG images, with more of a loss in colour than in brightness.
    assert grey.mean() < 1.5
    assert grey.max() < 9.0
    assert np.abs(difference).mean() < 3.0


def test_the_bundled_disparity_is_that_of_the_scene(scene, light_field):
    found = np.asarray(centre_disparity(scene, IMAGE_SIZE))
    off = np.abs(found - light_field.ground_truth) > 1e-4
    assert off.mean() < 1e-4  # rounding may move the edge of something by a pixel


def bilinear(image, y, x):
    top = np.clip(np.floor(y).astype(int), 0, image.shape[0] - 2)
    left = np.clip(np.floor(x).astype(int), 0, image.shape[1] - 2)
    fy, fx = (y - top)[..., None], (x - left)[..., None]
    upper = image[top, left] * (1 - fx) + image[top, left + 1] * fx
    lower = image[top + 1, left] * (1 - fx) + image[top + 1, left + 1] * fx
    return upper * (1 - fy) + lower * fy


@pytest.mark.parametrize("view", [(0, 0), (8, 3)])
def test_views_agree_where_the_scene_is_visible_and_only_there(scene, light_field, view):
    disparity = light_field.ground_truth
    v, u = view[0] - 4, view[1] - 4
    offset = jnp.array([v, u], jnp.float32)
    visible = np.asarray(view_visibility(scene, jnp.asarray(disparity), offset))
    y, x = np.mgrid[:256, :256].astype(np.float64)
    seen_y, seen_x = y - disparity * v, x - disparity * u
    inside = (seen_y >= 0) & (seen_y <= 255) & (seen_x >= 0) & (seen_x <= 255)
    images = light_field.grey()[..., None]
    error = np.abs(bilinear(images[view], seen_y, seen_x) - images[4, 4])[..., 0]
    hidden = inside & ~visible
    assert not visible[~inside].any()
    assert visible.mean() > 0.75
    assert hidden.mean() > 0.02
    assert np.median(error[visible]) < 0.01
    assert np.median(error[hidden]) > 5 * np.median(error[visible])


def test_the_calibration_gives_the_depth_at_which_the_scene_was_built(light_field):
    """Depth along the axis from disparity alone: the plane at zero disparity is in focus."""
    pixel = calibration().focus_distance_m / (RELIEF / PERSPECTIVE)  # metres a pixel in focus
    truth = light_field.ground_truth.astype(np.float64)
    towards_camera = RELIEF * truth / (1.0 + PERSPECTIVE * truth)
    expected = calibration().focus_distance_m - pixel * towards_camera
    found = light_field.calibration.depth(light_field.ground_truth, light_field.image_size)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_tiling_is_undone_by_untiling():
    views = np.random.default_rng(0).integers(0, 256, (2, 3, 4, 5, 3), np.uint8)
    mosaic = tile(views)
    assert mosaic[4:8, 10:15].tolist() == views[1, 2].tolist()
    np.testing.assert_array_equal(untile(mosaic, (2, 3)), views)


def test_writing_the_sample_keeps_its_disparity_and_nearly_its_colours(light_field, tmp_path):
    import imageio.v3 as imageio

    from occjax.data.procedural import Rendered
    from occjax.io.pfm import read_pfm

    rendered = Rendered(
        jnp.asarray(light_field.floating()[:1, :2]), jnp.asarray(light_field.ground_truth), None
    )
    write_sample(rendered, tmp_path)
    stored = untile(imageio.imread(tmp_path / "sample_views.jpg"), (1, 2))
    difference = stored.astype(int) - light_field.views[:1, :2]
    assert np.abs(difference).mean() < 3.0
    truth = read_pfm(tmp_path / "sample_disparity.pfm")
    np.testing.assert_array_equal(truth, light_field.ground_truth)
