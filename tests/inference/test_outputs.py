"""The folder of files of an estimate."""

import json
import math

import imageio.v3 as imageio
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.inference.outputs import write_outputs
from occjax.inference.result import Estimate
from occjax.io.pfm import read_pfm
from occjax.lightfield import Calibration, LightField

HEIGHT, WIDTH = 40, 50
CALIBRATION = Calibration(
    focal_length_mm=100.0, sensor_size_mm=35.0, baseline_mm=70.0, focus_distance_m=8.0
)
RANDOM = np.random.default_rng(0)
TRUTH = np.linspace(-1.0, 1.5, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)


def light_field(**changes):
    views = RANDOM.integers(0, 256, (3, 3, HEIGHT, WIDTH, 3), np.uint8)
    return LightField(**{"views": views, "name": "ramp", **changes})


def estimate(**changes):
    fields = {
        "disparity": TRUTH + np.float32(0.05),
        "confidence": np.full((HEIGHT, WIDTH), 0.75, np.float32),
        "standard_deviation": np.full((HEIGHT, WIDTH), 0.1, np.float32),
        "coarse": None,
        "find_occlusion": lambda: RANDOM.random((3, 3, HEIGHT, WIDTH), np.float32),
        "disparity_range": (-1.5, 2.0),
        "model": "photometric",
        "notes": ("a 3x3 grid is small",),
        "seconds": {"run": 0.12345},
    }
    return Estimate(**{**fields, **changes})


def test_a_calibrated_scene_with_truth_gets_every_file(tmp_path):
    scene = light_field(calibration=CALIBRATION, ground_truth=TRUTH)
    outputs = write_outputs(estimate(), scene, tmp_path / "ramp")
    assert [path.name for path in outputs.paths] == [
        "comparison.png",
        "confidence.png",
        "depth.npy",
        "disparity.npy",
        "disparity.pfm",
        "disparity.png",
        "error.png",
        "occlusion.png",
        "points.ply",
        "summary.json",
    ]
    assert set((tmp_path / "ramp").iterdir()) == set(outputs.paths)
    assert outputs.notes == ("a 3x3 grid is small",)


def test_without_calibration_and_truth_it_says_so_and_leaves_files_out(tmp_path):
    outputs = write_outputs(estimate(find_occlusion=None), light_field(), tmp_path / "ramp")
    names = {path.name for path in outputs.paths}
    assert names.isdisjoint({"depth.npy", "error.png", "occlusion.png"})
    assert {"points.ply", "comparison.png"} <= names
    assert "no calibration" in outputs.notes[-1]
    assert outputs.metrics is None


def test_both_disparity_files_hold_the_estimate(tmp_path):
    given = estimate()
    write_outputs(given, light_field(), tmp_path / "ramp")
    np.testing.assert_array_equal(np.load(tmp_path / "ramp/disparity.npy"), given.disparity)
    np.testing.assert_array_equal(read_pfm(tmp_path / "ramp/disparity.pfm"), given.disparity)


def test_summary_holds_what_was_done_and_how_well(tmp_path):
    disparity = TRUTH + np.float32(0.05)
    disparity[0, 0] = np.nan
    scene = light_field(ground_truth=TRUTH)
    outputs = write_outputs(estimate(disparity=disparity), scene, tmp_path / "ramp")
    summary = json.loads((tmp_path / "ramp/summary.json").read_text())
    assert summary["model"] == "photometric"
    assert summary["grid"] == [3, 3]
    assert summary["searched_disparity_range"] == [-1.5, 2.0]
    assert summary["disparity"]["missing"] == 1
    assert summary["disparity"]["maximum"] == pytest.approx(1.55)
    assert summary["seconds"] == {"run": 0.123}
    assert summary["notes"] == list(outputs.notes)
    assert 10 < summary["peak_memory_mb"] < 1e6
    assert set(summary["versions"]) == {"occjax", "jax", "numpy", "python"}
    # Everywhere 0.05 off: bad at 0.03, not at 0.07; (0.05)^2 * 100 = 0.25.
    assert summary["metrics"]["badpix"] == {"0.07": 0.0, "0.03": 100.0, "0.01": 100.0}
    assert summary["metrics"]["mse_x100"] == pytest.approx(0.25, rel=1e-4)


def test_the_same_estimate_gives_the_same_bytes(tmp_path):
    scene = light_field(ground_truth=TRUTH)
    given = estimate()
    for name in ("one", "other"):
        write_outputs(given, scene, tmp_path / name)
    for one in (tmp_path / "one").iterdir():
        if one.name != "summary.json":  # which has the peak memory so far
            assert one.read_bytes() == (tmp_path / "other" / one.name).read_bytes(), one.name


def test_a_failure_leaves_no_folder_behind(tmp_path, monkeypatch):
    def broken(*_args, **_options):
        raise RuntimeError("pulled the plug")

    monkeypatch.setattr("occjax.inference.conversion.write_ply", broken)
    with pytest.raises(RuntimeError, match="plug"):
        write_outputs(estimate(), light_field(), tmp_path / "ramp")
    assert list(tmp_path.iterdir()) == []


def test_a_failure_leaves_an_earlier_result_as_it_was(tmp_path, monkeypatch):
    folder = tmp_path / "ramp"
    write_outputs(estimate(), light_field(), folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    monkeypatch.setattr("occjax.inference.outputs.json.dumps", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_outputs(estimate(disparity=-TRUTH), light_field(), folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["ramp"]


def test_results_of_an_earlier_run_do_not_stay_beside_new_ones(tmp_path):
    folder = tmp_path / "ramp"
    write_outputs(estimate(), light_field(calibration=CALIBRATION, ground_truth=TRUTH), folder)
    (folder / "mine.png").write_text("mine")
    outputs = write_outputs(estimate(find_occlusion=None), light_field(), folder)
    assert set(folder.iterdir()) == {*outputs.paths, folder / "mine.png"}
    names = {path.name for path in outputs.paths}
    assert names.isdisjoint({"depth.npy", "error.png", "occlusion.png"})


def test_a_folder_with_the_name_of_a_result_changes_nothing(tmp_path):
    folder = tmp_path / "ramp"
    write_outputs(estimate(), light_field(), folder)
    (folder / "summary.json").unlink()
    (folder / "summary.json").mkdir()
    before = {path.name: path.is_dir() or path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(InputError, match=r"ramp/summary\.json: cannot be written"):
        write_outputs(estimate(disparity=-TRUTH), light_field(), folder)
    assert {p.name: p.is_dir() or p.read_bytes() for p in folder.iterdir()} == before


def test_wild_values_where_confidence_is_low_do_not_change_the_colours(tmp_path):
    disparity = TRUTH.copy()
    confidence = np.full((HEIGHT, WIDTH), 0.9, np.float32)
    disparity[:8, :8], confidence[:8, :8] = 40.0, 0.1
    scene = light_field()
    for name, given in (("calm", TRUTH), ("wild", disparity)):
        write_outputs(estimate(disparity=given, confidence=confidence), scene, tmp_path / name)
    for picture in ("disparity.png", "comparison.png"):
        calm, wild = (imageio.imread(tmp_path / name / picture) for name in ("calm", "wild"))
        # In the middle of the map nothing is wild; the colour bar may differ.
        height, width = calm.shape[0] // 2, calm.shape[1]
        left = width // 2 + 120 if picture == "comparison.png" else width // 4
        middle = np.s_[height : height + 60, left : left + 60, :3]
        np.testing.assert_allclose(wild[middle].astype(int), calm[middle].astype(int), atol=6)


def test_a_folder_that_cannot_be_made_is_an_input_error(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="file"):
        write_outputs(estimate(), light_field(), tmp_path / "file" / "ramp")


def test_points_at_infinity_and_without_disparity_are_left_out(tmp_path):
    disparity = TRUTH.copy()
    disparity[0, 0] = np.nan
    disparity[1, 1] = -1e3  # behind infinitely distant points
    scene = light_field(calibration=CALIBRATION)
    write_outputs(estimate(disparity=disparity), scene, tmp_path / "ramp")
    header = (tmp_path / "ramp/points.ply").read_bytes().split(b"end_header")[0].decode()
    assert f"element vertex {HEIGHT * WIDTH - 2}" in header
    assert math.isinf(np.load(tmp_path / "ramp/depth.npy")[1, 1])


def test_points_without_signal_are_left_out_and_told(tmp_path):
    scene = light_field()
    scene.views[:] = np.maximum(scene.views, 1)
    scene.views[1, 1, 2, 3] = 0  # black: nothing was seen
    scene.views[1, 1, 4, 5] = (0, 0, 1)  # as dark as light can be
    confidence = np.full((HEIGHT, WIDTH), 0.75, np.float32)
    confidence[6, 7] = 0.0
    outputs = write_outputs(estimate(confidence=confidence), scene, tmp_path / "ramp")
    header, body = (tmp_path / "ramp/points.ply").read_bytes().split(b"end_header\n", 1)
    assert f"element vertex {HEIGHT * WIDTH - 2}" in header.decode()
    points = np.ndarray((HEIGHT * WIDTH - 2, 2), "<f4", body, strides=(15, 4))
    # Pixels by their place in space: x to the right, y up, from the middle.
    there = {(HEIGHT / 2 - 0.5 - y, x + WIDTH / 2 - 0.5) for x, y in points.tolist()}
    every = {(y, x) for y in range(HEIGHT) for x in range(WIDTH)}
    assert every - there == {(2, 3), (6, 7)}
    assert any(f"leaves out 2 of {HEIGHT * WIDTH} pixels" in note for note in outputs.notes)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_points_have_the_colours_of_the_centre_view(tmp_path, channels, dtype):
    views = np.zeros((1, 3, 4, 4, channels), dtype)
    views[0, 1] = 1.0 if dtype == np.float32 else np.iinfo(dtype).max
    flat = np.zeros((4, 4), np.float32)
    given = estimate(disparity=flat, confidence=flat + 1.0, find_occlusion=None)
    write_outputs(given, LightField(views=views), tmp_path / "scene")
    body = (tmp_path / "scene/points.ply").read_bytes().split(b"end_header\n", 1)[1]
    assert np.frombuffer(body, np.uint8).reshape(16, 15)[:, 12:].tolist() == [[255] * 3] * 16


def test_small_images_and_empty_truth_are_told(tmp_path):
    flat = np.zeros((8, 8), np.float32)
    given = estimate(disparity=flat, confidence=flat, find_occlusion=None)
    views = np.zeros((3, 3, 8, 8, 3), np.uint8)
    small = write_outputs(given, LightField(views=views, ground_truth=flat), tmp_path / "small")
    assert small.metrics.border == 0
    assert any("too small" in note for note in small.notes)
    empty = LightField(views=views, ground_truth=np.full_like(flat, np.nan))
    told = write_outputs(given, empty, tmp_path / "empty")
    assert told.metrics is None
    assert any("no finite value" in note for note in told.notes)
