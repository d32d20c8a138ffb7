"""Smoke test of the HCI training, averaged crops, and errors about scenes and masks."""

import dataclasses

import imageio.v3 as imageio
import numpy as np
import pytest

from experiments import hci_scenes, train_hci
from experiments.train_hci import ADDITIONAL, VALIDATION
from occjax.data.scenes import Scene
from occjax.errors import InputError
from occjax.io.hci_config import GROUND_TRUTH
from occjax.lightfield import LightField
from occjax.training import read_log


def folders(hci, names=(*ADDITIONAL, *VALIDATION)):
    """Create folders of scenes with empty ground truth."""
    for name in names:
        (hci / "archive" / name).mkdir(parents=True)
        (hci / "archive" / name / GROUND_TRUTH).touch()
    return {name: hci / "archive" / name for name in names}


@pytest.mark.slow
def test_smoke_test_trains_and_resumes(tmp_path, capsys, tolerance):
    scores = train_hci.run(output=tmp_path, small=True)
    log = read_log(tmp_path / "training")
    validated = [entry for entry in log if entry["kind"] == "validation"]
    assert [entry["step"] for entry in validated] == [1, 2]
    best = min(validated, key=lambda entry: entry["badpix_0.07"])
    mse = scores["whole"]["boxes/mse_x100"]
    np.testing.assert_allclose(mse, best["boxes/mse_x100"], **tolerance("amplified"))
    assert scores["crops"]["mse_x100"] != scores["whole"]["mse_x100"]
    printed = capsys.readouterr().out
    written = (tmp_path / "scores.md").read_text()
    assert written in printed
    assert f"| boxes | {scores['whole']['badpix_0.07']:.3f} |" in written
    assert "| paper, mean of 8 |  | 1.733 |  | 0.762 |" in written

    assert train_hci.run(output=tmp_path, small=True) == scores
    assert read_log(tmp_path / "training") == log
    with pytest.raises(InputError, match="seed"):
        train_hci.run(output=tmp_path, small=True, seed=1)


def test_crops_are_averaged_where_they_overlap():
    size = 16
    ramp = np.tile(np.arange(size, dtype=np.uint8), (size, 1))
    light_field = LightField(np.tile(ramp, (3, 3, 1, 1)), ground_truth=ramp.T)
    # A function of the position is recovered exactly.
    both = train_hci.averaged_crops(
        lambda crop: crop.centre[..., 0] + 100.0 * crop.ground_truth, light_field
    )
    np.testing.assert_allclose(both, ramp + 100.0 * ramp.T)
    # Where crops differ, the result is their mean; crop k, row by row, returns k.
    number = iter(range(9))
    mean = train_hci.averaged_crops(
        lambda crop: np.full(crop.image_size, next(number)), light_field
    )
    assert mean[0, 0] == 0.0
    assert mean[0, 4] == 0.5
    assert mean[5, 5] == np.mean([0, 1, 3, 4])
    assert mean[15, 15] == 8.0


def test_all_missing_scenes_are_named(tmp_path):
    gone = ("kitchen", "town", "dots")
    folders(tmp_path, [name for name in (*ADDITIONAL, *VALIDATION) if name not in gone])
    with pytest.raises(InputError, match=r"has no folder kitchen, town, dots, neither") as error:
        train_hci.run(tmp_path, output=tmp_path / "out")
    assert "antinous" not in str(error.value)


def test_scenes_without_ground_truth_are_named(tmp_path):
    places = folders(tmp_path)
    (places["greek"] / GROUND_TRUTH).unlink()
    with pytest.raises(InputError, match=f"{GROUND_TRUTH} is missing in greek"):
        train_hci.run(tmp_path, output=tmp_path / "out")


def test_masks_are_found_next_to_the_scenes_or_in_them(tmp_path):
    hci = tmp_path / "hci"
    places = folders(hci)
    with pytest.raises(InputError, match="kitchen, museum, vinyl need masks"):
        hci_scenes.shared_masks(hci, places, None)
    assert hci_scenes.shared_masks(hci, places, None, needed=False) == {}
    (places["museum"] / "mask.png").touch()
    for folder in (hci / "additional_invalid_area", tmp_path / "elsewhere"):
        for name in ("kitchen", "vinyl"):
            (folder / name).mkdir(parents=True)
            (folder / name / "invalid.png").touch()
    for masks in (None, tmp_path / "elsewhere"):
        found = hci_scenes.shared_masks(hci, places, masks)
        folder = masks or hci / "additional_invalid_area"
        # The mask of museum is read with the scene.
        assert found == {name: folder / name / "invalid.png" for name in ("kitchen", "vinyl")}
    # The folders of masks are not mistaken for scenes.
    assert train_hci.places_of(hci, ADDITIONAL)["kitchen"] == places["kitchen"]
    (tmp_path / "elsewhere/vinyl/other.png").touch()
    with pytest.raises(InputError, match="has 2 images"):
        hci_scenes.shared_masks(hci, places, tmp_path / "elsewhere")
    with pytest.raises(InputError, match="absent: is not a folder"):
        hci_scenes.shared_masks(hci, places, tmp_path / "absent")


def test_opaque_pixels_are_masked(tmp_path):
    valid = np.ones((4, 5), bool)
    valid[3] = False
    scene = Scene("kitchen", np.zeros(0), np.zeros(0), np.zeros((4, 5)), valid, masked=False)
    image = np.full((4, 5, 4), 200, np.uint8)
    image[..., 3] = 0
    image[1, 2, 3] = 255
    imageio.imwrite(tmp_path / "a.png", image)
    masked = hci_scenes.with_mask(scene, tmp_path / "a.png")
    expected = valid.copy()
    expected[1, 2] = False
    np.testing.assert_array_equal(masked.valid, expected)
    assert masked.masked
    grey = np.zeros((4, 5), np.uint8)
    grey[1, 2] = 9
    imageio.imwrite(tmp_path / "g.png", grey)
    np.testing.assert_array_equal(hci_scenes.with_mask(scene, tmp_path / "g.png").valid, expected)
    assert hci_scenes.with_mask(scene, None) is scene
    small = dataclasses.replace(scene, disparity=np.zeros((2, 2)), valid=np.ones((2, 2), bool))
    with pytest.raises(InputError, match=r"is \[4, 5\] but the views are \[2, 2\]"):
        hci_scenes.with_mask(small, tmp_path / "g.png")
    imageio.imwrite(tmp_path / "all.png", np.full((4, 5, 4), 255, np.uint8))
    with pytest.raises(InputError, match="masks every pixel"):
        hci_scenes.with_mask(scene, tmp_path / "all.png")
    (tmp_path / "b.png").write_bytes(b"no image")
    with pytest.raises(InputError, match=r"b\.png"):
        hci_scenes.with_mask(scene, tmp_path / "b.png")


def test_a_folder_or_small_is_needed(tmp_path):
    for arguments in ({}, {"hci": tmp_path, "small": True}):
        with pytest.raises(InputError, match="or pass --small alone"):
            train_hci.run(output=tmp_path / "out", **arguments)
