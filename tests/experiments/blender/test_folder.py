import json

import imageio.v3 as imageio
import numpy as np
import pytest

import occjax
from experiments.blender import RenderConfig
from experiments.blender.folder import (
    masks,
    missing_views,
    read_record,
    view_name,
    write_ground_truth,
)
from occjax.errors import InputError
from occjax.io import read_pfm

RIG = {
    "focal_length_mm": 50.0,
    "sensor_size_mm": 36.0,
    "baseline_mm": 7.0 / 3.0,
    "focus_distance_m": 1.2,
}
CONFIG = RenderConfig(seed=4, image_size=(24, 40), grid=(3, 5), samples=1)


@pytest.fixture
def scene(tmp_path):
    """Folder with the renderer's files: two half planes at 1 m and 2 m, and grey views."""
    folder = tmp_path / "s004"
    folder.mkdir()
    depth = np.full(CONFIG.image_size, 2.0, np.float32)
    depth[:, :20] = 1.0
    objects = np.where(depth == 1.0, 1, 2).astype(np.int32)
    np.savez(folder / "geometry.npz", depth=depth, objects=objects, facing=np.ones_like(depth))
    record = {"config": CONFIG.as_dict(), "style": "room", "rig": RIG, "plain": [2], "glossy": []}
    (folder / "scene.json").write_text(json.dumps(record))
    for number in range(CONFIG.views):
        imageio.imwrite(folder / view_name(number), np.full((24, 40, 3), number, np.uint8))
    return folder


def test_folder_loads_as_a_light_field_with_ground_truth_and_calibration(scene, tolerance):
    write_ground_truth(scene, CONFIG)
    light_field = occjax.load(scene, check_orientation=False)
    assert light_field.grid == (3, 5)
    assert light_field.views[2, 1, 0, 0, 0] == 11
    # 50 / 36 * 40 pixels times 7 / 3 mm times (1 / 1 m - 1 / 1.2 m) and (1 / 2 m - 1 / 1.2 m).
    unit = 50 / 36 * 40 * 0.007 / 3
    near, far = unit * (1 - 1 / 1.2), unit * (1 / 2 - 1 / 1.2)
    np.testing.assert_allclose(light_field.ground_truth[:, :20], near, **tolerance("relative"))
    np.testing.assert_allclose(light_field.ground_truth[:, 20:], far, **tolerance("relative"))
    assert light_field.calibration == occjax.Calibration(**RIG)
    low, high = light_field.disparity_range
    assert low <= far < near <= high
    assert high - low < 1.1 * (near - far)
    depth = light_field.calibration.depth(light_field.ground_truth, light_field.image_size)
    np.testing.assert_allclose(
        depth, read_pfm(scene / "gt_depth_lowres.pfm"), **tolerance("relative")
    )


def test_masks_are_written_as_images(scene):
    write_ground_truth(scene, CONFIG)
    plain = imageio.imread(scene / "masks" / "plain.png")
    assert np.unique(plain[:, :20]) == [0]
    assert np.unique(plain[:, 20:]) == [255]
    assert np.unique(imageio.imread(scene / "masks" / "objects.png")).tolist() == [1, 2]


def test_discontinuities_are_the_two_pixels_on_each_side_of_an_edge():
    disparity = np.zeros((9, 20), np.float32)
    disparity[:, 10:] = 0.5
    disparity += 0.05 * np.arange(20, dtype=np.float32)  # a slope is not an edge
    flat = np.ones_like(disparity)
    regions = masks(disparity, flat.astype(int), flat, plain=[], glossy=[])
    assert np.flatnonzero(regions["discontinuities"].any(0)).tolist() == [8, 9, 10, 11]


def test_planes_end_where_the_object_or_the_normal_changes():
    objects = np.ones((7, 20), int)
    objects[:, 5:] = 2
    facing = np.zeros((7, 20), np.float32)
    facing[:, 12:] = np.linspace(0.0, 1.0, 8)
    disparity = np.zeros((7, 20), np.float32)
    planes = masks(disparity, objects, facing, plain=[], glossy=[])["planes"]
    assert (planes == planes[:1]).all()
    assert np.flatnonzero(planes[0]).tolist() == [0, 1, 2, 3, 6, 7, 8, 9, 10, 11]


def test_missing_views_are_listed(scene):
    (scene / view_name(3)).unlink()
    assert missing_views(scene, CONFIG) == [3]


def test_folder_of_another_scene_is_rejected_with_the_difference(scene):
    other = RenderConfig(seed=5, image_size=(24, 40), grid=(3, 5), samples=1)
    with pytest.raises(InputError, match="seed 4 not 5"):
        read_record(scene, other)


def test_damaged_description_is_rejected(scene):
    (scene / "scene.json").write_text("{")
    with pytest.raises(InputError, match="damaged"):
        read_record(scene, CONFIG)
