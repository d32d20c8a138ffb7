"""Masks, calibration and runtime of a scene's folder."""

import imageio.v3 as imageio
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.evaluation.scene_files import (
    MissingFileError,
    is_scene,
    read_calibration,
    read_mask,
    read_seconds,
)

REGION = np.array([[1, 0, 0], [0, 1, 1]], bool)


def write(path, image):
    path.parent.mkdir(exist_ok=True)
    imageio.imwrite(path, image)


@pytest.mark.parametrize("name", ["mask_planes_lowres.png", "mask_planes.png", "masks/planes.png"])
@pytest.mark.parametrize("value", [1, 255])
def test_mask_is_the_part_that_is_not_black(tmp_path, name, value):
    write(tmp_path / name, (value * REGION).astype(np.uint8))
    np.testing.assert_array_equal(read_mask(tmp_path, "planes", (2, 3)), REGION)


@pytest.mark.parametrize("channels", [3, 4])
def test_any_colour_counts_but_transparency_does_not(tmp_path, channels):
    image = np.zeros((2, 3, channels), np.uint8)
    image[REGION, 1] = 200
    image[..., 3:] = 255
    write(tmp_path / "mask_fine_lowres.png", image)
    np.testing.assert_array_equal(read_mask(tmp_path, "fine", (2, 3)), REGION)


def test_high_resolution_mask_is_sampled_at_the_middle_of_each_pixel(tmp_path):
    large = np.kron(~REGION, np.ones((5, 5), bool))
    large[2::5, 2::5] = REGION  # the middles differ from the other pixels
    write(tmp_path / "mask_fine_highres.png", (255 * large).astype(np.uint8))
    np.testing.assert_array_equal(read_mask(tmp_path, "fine", (2, 3)), REGION)


def test_mask_of_the_right_resolution_has_priority(tmp_path):
    write(tmp_path / "mask_fine_highres.png", np.zeros((20, 30), np.uint8))
    write(tmp_path / "mask_fine_lowres.png", (255 * REGION).astype(np.uint8))
    np.testing.assert_array_equal(read_mask(tmp_path, "fine", (2, 3)), REGION)


def test_missing_mask_is_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"no such mask and no masks/planes\.png") as caught:
        read_mask(tmp_path, "planes", (2, 3))
    assert caught.value.missing == "mask_planes_lowres.png"
    assert str(tmp_path / "mask_planes_lowres.png") in str(caught.value)


@pytest.mark.parametrize("size", [(3, 3), (4, 3), (1, 2), (5, 7)])
def test_mask_of_another_size_is_refused(tmp_path, size):
    write(tmp_path / "mask_fine_lowres.png", np.full(size, 255, np.uint8))
    with pytest.raises(InputError, match=r"mask_fine_lowres.png: is .* whole multiple") as caught:
        read_mask(tmp_path, "fine", (2, 3))
    assert not isinstance(caught.value, MissingFileError)


def test_missing_parameters_are_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"parameters.cfg: there is no such file"):
        read_calibration(tmp_path)


def test_run_time_of_a_results_folder_and_of_a_submission(tmp_path):
    (tmp_path / "summary.json").write_text('{"seconds": {"compile": 9.0, "run": 1.25}}')
    assert read_seconds(tmp_path) == 1.25
    assert read_seconds(tmp_path / "disparity.pfm") == 1.25
    (tmp_path / "disp_maps").mkdir()
    (tmp_path / "runtimes").mkdir()
    (tmp_path / "runtimes/cotton.txt").write_text("7.5\n")
    assert read_seconds(tmp_path / "disp_maps/cotton.pfm") == 7.5
    with pytest.raises(MissingFileError, match=r"boxes.txt"):
        read_seconds(tmp_path / "disp_maps/boxes.pfm")


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"seconds": 1}', '{"seconds": {"run": NaN}}', '{"seconds": {"run": -1}}'],
)
def test_damaged_run_time_is_refused(tmp_path, text):
    (tmp_path / "summary.json").write_text(text)
    with pytest.raises(InputError, match=r"summary.json: .*remove the file") as caught:
        read_seconds(tmp_path)
    assert not isinstance(caught.value, MissingFileError)


def test_scene_is_a_folder_with_ground_truth(tmp_path):
    assert not is_scene(tmp_path)
    (tmp_path / "gt_disp_lowres.pfm").touch()
    assert is_scene(tmp_path)
    assert not is_scene(tmp_path / "gt_disp_lowres.pfm")
