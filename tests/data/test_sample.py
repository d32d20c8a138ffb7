"""The bundled sample is consistent with its ground truth, and made of a scene's folder."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates, maximum_filter

from occjax.data.sample import sample, write_sample
from occjax.errors import InputError
from occjax.io import read_image, read_pfm, split_tiles, write_pfm
from occjax.lightfield import GREY_WEIGHTS
from occjax.render.folder import view_name
from tests.io.files import CONFIG, hci, save_views
from tests.scenes import plane


@pytest.fixture(scope="module")
def light_field():
    return sample()


def test_the_sample_is_a_whole_light_field(light_field):
    assert light_field.grid == (9, 9)
    assert light_field.image_size == (256, 256)
    assert light_field.views.dtype == np.uint8
    truth = light_field.ground_truth
    assert np.isfinite(truth).all()
    assert np.ptp(truth) > 2.0
    lowest, highest = light_field.disparity_range
    assert lowest <= truth.min() < lowest + 2e-3
    assert highest - 2e-3 < truth.max() <= highest


def nearest(disparity, v, u):
    """Largest disparity within a pixel of where each point of the centre view lies in a view."""
    found = np.full(disparity.shape, -np.inf)
    for y, x in np.ndindex(disparity.shape):
        row, column = round(y - disparity[y, x] * v), round(x - disparity[y, x] * u)
        if 0 <= row < found.shape[0] and 0 <= column < found.shape[1]:
            found[row, column] = max(found[row, column], disparity[y, x])
    return maximum_filter(found, 3)


@pytest.mark.parametrize("view", [(0, 1), (8, 3)])
def test_views_agree_where_nothing_is_in_front_and_only_there(light_field, view):
    disparity = light_field.ground_truth.astype(np.float64)
    v, u = view[0] - 4, view[1] - 4
    y, x = np.mgrid[:256, :256].astype(np.float64)
    seen_y, seen_x = y - disparity * v, x - disparity * u
    inside = (seen_y >= 0) & (seen_y <= 255) & (seen_x >= 0) & (seen_x <= 255)
    images = light_field.grey()
    error = np.abs(map_coordinates(images[view], [seen_y, seen_x], order=1) - images[4, 4])
    places = np.rint(np.clip([seen_y, seen_x], 0, 255)).astype(int)
    before = nearest(disparity, v, u)[tuple(places)] - disparity
    hidden, visible = inside & (before > 0.3), inside & (before < 0.05)
    assert hidden.mean() > 0.01
    assert visible.mean() > 0.6
    assert np.median(error[visible]) < 0.02
    assert np.median(error[hidden]) > 3 * np.median(error[visible])


def test_a_scene_becomes_the_bundled_files(tmp_path):
    whole = plane(grid=(9, 9), size=(32, 24), slope=(0.01, -0.02))
    views, truth = (whole.views * 255).round().astype(np.uint8), whole.ground_truth
    scene = save_views(tmp_path / "scene", views, lambda v, u: view_name(9 * v + u))
    write_pfm(scene / "gt_disp_lowres.pfm", truth)
    config = CONFIG.replace("cams_x = 3", "cams_x = 9").replace("cams_y = 3", "cams_y = 9")
    (scene / "parameters.cfg").write_text(config)
    target = tmp_path / "bundled"
    target.mkdir()
    write_sample(scene, target)
    stored = split_tiles(read_image(target / "sample_views.jpg"), (9, 9))
    difference = stored.astype(int) - views
    # Errors uniform within the steps of quantisation have means of 1.2 in grey, of 3.8 in colour.
    assert np.abs(difference @ np.array(GREY_WEIGHTS)).mean() < 1.5
    assert np.abs(difference).mean() < 4.0
    np.testing.assert_array_equal(read_pfm(target / "sample_disparity.pfm"), truth)
    assert (target / "sample_parameters.cfg").read_text() == config


@pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")
def test_what_lacks_something_is_refused_before_anything_is_written(tmp_path):
    scene = save_views(tmp_path / "scene", np.zeros((3, 3, 32, 24, 3), np.uint8), hci)
    write_pfm(tmp_path / "truth.pfm", np.zeros((32, 24), np.float32))
    (tmp_path / "config").write_text(CONFIG)
    kept = {path.name for path in tmp_path.iterdir()}
    for lacking, given, name in (
        ("no gt_disp_lowres", "config", "parameters.cfg"),
        ("3x3 views", "truth.pfm", "gt_disp_lowres.pfm"),
    ):
        (scene / name).write_bytes((tmp_path / given).read_bytes())
        with pytest.raises(InputError, match=lacking):
            write_sample(scene, tmp_path)
    (scene / "parameters.cfg").unlink()
    with pytest.raises(InputError, match="no parameters"):
        write_sample(scene, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == kept
