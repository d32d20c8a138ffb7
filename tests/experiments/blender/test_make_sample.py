"""A rendered scene becomes the files of the bundled sample."""

import numpy as np
import pytest

from experiments.blender.folder import view_name
from experiments.blender.make_sample import make_sample
from occjax.errors import InputError
from occjax.io import read_image, read_pfm, split_tiles, write_pfm
from occjax.lightfield import GREY_WEIGHTS
from tests.io.files import CONFIG, hci, save_views
from tests.scenes import plane


def test_a_scene_becomes_the_bundled_files(tmp_path):
    whole = plane(grid=(9, 9), size=(32, 24), slope=(0.01, -0.02))
    views, truth = (whole.views * 255).round().astype(np.uint8), whole.ground_truth
    scene = save_views(tmp_path / "scene", views, lambda v, u: view_name(9 * v + u))
    write_pfm(scene / "gt_disp_lowres.pfm", truth)
    config = CONFIG.replace("cams_x = 3", "cams_x = 9").replace("cams_y = 3", "cams_y = 9")
    (scene / "parameters.cfg").write_text(config)
    target = tmp_path / "bundled"
    target.mkdir()
    make_sample(scene, target)
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
            make_sample(scene, tmp_path)
    (scene / "parameters.cfg").unlink()
    with pytest.raises(InputError, match="no parameters"):
        make_sample(scene, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == kept
