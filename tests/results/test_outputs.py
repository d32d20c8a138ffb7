"""The folder of files of an estimate."""

import json
import math

import numpy as np
import pytest
from PIL import Image

from occjax.errors import InputError
from occjax.estimators import Estimate
from occjax.io import read_map, read_pfm
from occjax.lightfield import LightField
from occjax.results.outputs import FILES, OutputOptions, output_options, write_outputs
from tests.io.test_ply import read_vertices
from tests.results.test_conversion import CAMERA, HEIGHT, WIDTH

RANDOM = np.random.default_rng(0)
TRUTH = np.linspace(-1.0, 1.5, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)
OF_ALL_VIEWS = {"views.npz", "views.ply"}
OPTIONAL = {
    *("depth.npy", "error.png", "ground_truth.npy"),
    *("occlusion.npy", "occlusion.png", "stages.npy"),
}
EVERYTHING = output_options("all", None)


def light_field(**changes):
    views = RANDOM.integers(0, 256, (3, 3, HEIGHT, WIDTH, 3), np.uint8)
    return LightField(**{"views": views, "name": "ramp", **changes})


def estimate(**changes):
    fields = {
        "disparity": TRUTH + np.float32(0.05),
        "confidence": np.full((HEIGHT, WIDTH), 0.75, np.float32),
        "standard_deviation": np.full((HEIGHT, WIDTH), 0.1, np.float32),
        "coarse": None,
        "occlusion": RANDOM.random((3, 3, HEIGHT, WIDTH), np.float32),
        "disparity_range": (-1.5, 2.0),
        "model": "photometric",
        "weights": None,
        "notes": ("a 3x3 grid is small",),
        "seconds": {"run": 0.12345},
        "stages": (),
    }
    return Estimate(**{**fields, **changes})


def contents(folder):
    return {path.name: path.is_dir() or path.read_bytes() for path in folder.iterdir()}


def test_a_calibrated_scene_with_truth_gets_every_file(tmp_path, tolerance):
    disparity = TRUTH + np.float32(0.05)
    disparity[0, 0] = np.nan
    scene = light_field(calibration=CAMERA, ground_truth=TRUTH)
    given = estimate(disparity=disparity, stages=(TRUTH, disparity))
    outputs = write_outputs(given, scene, tmp_path / "ramp", EVERYTHING)
    assert {path.name for path in outputs.paths} == set(FILES) - OF_ALL_VIEWS
    assert set((tmp_path / "ramp").iterdir()) == set(outputs.paths)
    np.testing.assert_array_equal(np.load(tmp_path / "ramp/disparity.npy"), disparity)
    np.testing.assert_array_equal(read_pfm(tmp_path / "ramp/disparity.pfm"), disparity)
    np.testing.assert_array_equal(np.load(tmp_path / "ramp/confidence.npy"), 0.75)
    assert np.load(tmp_path / "ramp/occlusion.npy").shape == (3, 3, HEIGHT, WIDTH)

    summary = json.loads((tmp_path / "ramp/summary.json").read_text())
    assert summary["model"] == "photometric"
    assert summary["grid"] == [3, 3]
    assert summary["searched_disparity_range"] == [-1.5, 2.0]
    assert summary["disparity"]["missing"] == 1
    assert summary["disparity"]["maximum"] == pytest.approx(1.55)
    assert summary["seconds"] == {"run": 0.123}
    assert summary["notes"] == list(outputs.notes) == ["a 3x3 grid is small"]
    assert 10 < summary["peak_memory_mb"] < 1e6
    assert set(summary["versions"]) == {"occjax", "jax", "numpy", "python"}
    # All errors are 0.05: bad at 0.03, not at 0.07; (0.05)^2 * 100 = 0.25.
    assert summary["metrics"]["badpix"] == {"0.07": 0.0, "0.03": 100.0, "0.01": 100.0}
    np.testing.assert_allclose(summary["metrics"]["mse_x100"], 0.25, **tolerance("relative"))


def test_files_of_an_earlier_estimate_are_removed_and_others_kept(tmp_path):
    for name in OPTIONAL:
        (tmp_path / name).write_text("earlier")
    (tmp_path / "mine.png").write_text("mine")
    outputs = write_outputs(estimate(occlusion=None), light_field(), tmp_path, EVERYTHING)
    assert {path.name for path in outputs.paths} == set(FILES) - OPTIONAL - OF_ALL_VIEWS
    assert set(tmp_path.iterdir()) == {*outputs.paths, tmp_path / "mine.png"}
    assert "no calibration" in outputs.notes[-1]
    assert outputs.metrics is None


def test_equal_estimates_give_equal_bytes(tmp_path):
    scene, given = light_field(ground_truth=TRUTH), estimate()
    for name in ("one", "other"):
        write_outputs(given, scene, tmp_path / name, EVERYTHING)
    one, other = contents(tmp_path / "one"), contents(tmp_path / "other")
    del one["summary.json"], other["summary.json"]  # they contain the peak memory
    assert one == other


def test_a_failure_leaves_an_earlier_result_unchanged(tmp_path, monkeypatch):
    folder = tmp_path / "ramp"
    write_outputs(estimate(), light_field(), folder)
    before = contents(folder)
    with monkeypatch.context() as patched:
        patched.setattr("occjax.results.outputs.json.dumps", lambda *_, **__: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            write_outputs(estimate(disparity=-TRUTH), light_field(), folder)
    assert contents(folder) == before
    assert [path.name for path in tmp_path.iterdir()] == ["ramp"]

    (folder / "summary.json").unlink()
    (folder / "summary.json").mkdir()
    before = contents(folder)
    with pytest.raises(InputError, match=r"ramp/summary\.json: cannot be written"):
        write_outputs(estimate(disparity=-TRUTH), light_field(), folder)
    assert contents(folder) == before


def test_pixels_without_point_or_signal_are_left_out_of_the_points(tmp_path):
    scene = light_field(calibration=CAMERA)
    scene.views[:] = np.maximum(scene.views, 1)
    scene.views[1, 1, 2, 3] = 0  # black: no signal
    scene.views[1, 1, 4, 5] = (0, 0, 1)  # the darkest pixel with signal
    disparity, confidence = TRUTH.copy(), np.full((HEIGHT, WIDTH), 0.75, np.float32)
    confidence[6, 7] = 0.0
    disparity[0, 0] = np.nan
    disparity[1, 1] = -1e3  # behind infinitely distant points
    given = estimate(disparity=disparity, confidence=confidence)
    outputs = write_outputs(given, scene, tmp_path / "ramp")
    assert math.isinf(np.load(tmp_path / "ramp/depth.npy")[1, 1])
    assert any(f"leaves out 2 of {HEIGHT * WIDTH} pixels" in note for note in outputs.notes)

    vertices, _ = read_vertices(tmp_path / "ramp/points.ply")
    focal_length = CAMERA.focal_length_pixels((HEIGHT, WIDTH))
    x = vertices["x"] / -vertices["z"] * focal_length + (WIDTH - 1) / 2
    y = (HEIGHT - 1) / 2 - vertices["y"] / -vertices["z"] * focal_length
    present = set(zip(np.rint(y).astype(int), np.rint(x).astype(int), strict=True))
    assert set(np.ndindex(HEIGHT, WIDTH)) - present == {(0, 0), (1, 1), (2, 3), (6, 7)}


def test_small_images_have_a_small_border_and_empty_truth_is_noted(tmp_path):
    flat = np.zeros((8, 8), np.float32)
    given = estimate(disparity=flat, confidence=flat, occlusion=None)
    views = np.zeros((3, 3, 8, 8, 3), np.uint8)
    small = write_outputs(given, LightField(views=views, ground_truth=flat), tmp_path / "small")
    assert small.metrics.border == 1
    empty = LightField(views=views, ground_truth=np.full_like(flat, np.nan))
    outputs = write_outputs(given, empty, tmp_path / "empty")
    assert outputs.metrics is None
    assert any("no finite value" in note for note in outputs.notes)


def test_pixels_without_signal_are_grey_in_pictures(tmp_path):
    scene, confidence = light_field(), np.full((HEIGHT, WIDTH), 0.75, np.float32)
    scene.views[:] = np.maximum(scene.views, 1)
    scene.views[1, 1, 2, 3] = 0
    confidence[6, 7] = 0.0
    write_outputs(estimate(confidence=confidence), scene, tmp_path)
    for name in ("disparity_picture.png", "confidence.png"):
        picture = np.asarray(Image.open(tmp_path / name))
        grey = np.argwhere((picture == 0x8A).all(axis=-1))
        assert grey.tolist() == [[2, 3], [6, 7]]


def test_uncertain_points_and_those_between_two_surfaces_are_left_out_on_request(tmp_path):
    disparity = np.zeros((HEIGHT, WIDTH), np.float32)
    disparity[:, 10] = 0.5
    disparity[:, 11:] = 1.0
    confidence = np.full((HEIGHT, WIDTH), 0.75, np.float32)
    confidence[3, 4] = 0.4
    scene = light_field()
    scene.views[:] = np.maximum(scene.views, 1)
    given = estimate(disparity=disparity, confidence=confidence)
    for min_confidence, left_out in ((None, 0), (0.5, HEIGHT + 1)):
        options = OutputOptions(("cloud",), min_confidence)
        write_outputs(given, scene, tmp_path, options)
        vertices, _ = read_vertices(tmp_path / "points.ply")
        assert len(vertices) == HEIGHT * WIDTH - left_out


def test_an_estimate_is_the_same_after_saving_and_loading(tmp_path, tolerance):
    scene = light_field(calibration=CAMERA, ground_truth=TRUTH)
    disparity = TRUTH + RANDOM.random(TRUTH.shape, np.float32)
    disparity[0, 0] = np.nan
    saved = estimate(disparity=disparity, stages=(TRUTH, disparity), light_field=scene)
    saved.save(tmp_path, what="all")
    loaded = Estimate.load(tmp_path)
    for name in ("disparity", "confidence", "standard_deviation", "stages"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(saved, name))
    np.testing.assert_array_equal(loaded.coarse, TRUTH)
    np.testing.assert_allclose(
        loaded.occlusion, saved.occlusion, **tolerance("float16")
    )  # half precision
    for name in ("disparity_range", "model", "weights", "notes"):
        assert getattr(loaded, name) == getattr(saved, name)
    stored = loaded.light_field
    assert (stored.name, stored.grid, stored.calibration) == ("ramp", (3, 3), CAMERA)
    np.testing.assert_array_equal(stored.ground_truth, TRUTH)
    np.testing.assert_array_equal(stored.centre, scene.centre)
    assert stored.usable.sum() == 1

    loaded.save(tmp_path / "again", what="all")
    before, after = contents(tmp_path), contents(tmp_path / "again")
    for files in (before, after):
        files.pop("again", None)
        del files["summary.json"], files["occlusion.png"]  # peak memory; half precision
    assert before == after

    assert Estimate.load(tmp_path, light_field=scene).light_field is scene
    with pytest.raises(InputError, match="pass the light field that was estimated"):
        Estimate.load(tmp_path, light_field=LightField(np.zeros((3, 3, 5, 5), np.uint8)))


def test_notes_on_the_files_are_only_those_of_the_files_that_were_written_last(tmp_path):
    first = write_outputs(estimate(), light_field(), tmp_path / "first", EVERYTHING)
    assert any("points.ply" in note for note in first.notes)
    for what, notes in (("all", first.notes), ("maps", ("a 3x3 grid is small",))):
        outputs = Estimate.load(tmp_path / "first").save(tmp_path / what, what=what)
        assert outputs.notes == notes
        assert json.loads((tmp_path / what / "summary.json").read_text())["notes"] == list(notes)


def test_a_folder_of_an_older_version_is_loaded_and_others_are_refused(tmp_path):
    write_outputs(estimate(), light_field(), tmp_path)
    for name in ("centre.png", "standard_deviation.npy"):
        (tmp_path / name).unlink()
    loaded = Estimate.load(tmp_path)
    assert loaded.light_field is None
    assert np.isnan(loaded.standard_deviation).all()
    with pytest.raises(InputError, match="has no light field"):
        loaded.save(tmp_path)
    (tmp_path / "summary.json").write_text("{}")
    with pytest.raises(InputError, match=r"summary\.json: cannot be decoded"):
        Estimate.load(tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"pass a folder that occjax estimate wrote$"):
        Estimate.load(tmp_path / "empty")


def test_results_that_were_saved_without_maps_are_refused_with_the_remedy(tmp_path):
    write_outputs(estimate(), light_field(), tmp_path, OutputOptions(("occlusion",)))
    for read in (Estimate.load, read_map):
        with pytest.raises(InputError, match=r"saved without maps; .* add maps to --save"):
            read(tmp_path)


@pytest.mark.parametrize("value", [-0.1, 1.5, float("nan")])
def test_a_confidence_that_is_none_is_refused(value):
    with pytest.raises(InputError, match="min_confidence"):
        OutputOptions(min_confidence=value)


def test_all_groups_may_be_named_with_others():
    assert output_options("all,maps", None) == EVERYTHING


@pytest.mark.parametrize("save", ["", " , ", ()])
def test_nothing_to_save_is_refused(save):
    with pytest.raises(InputError, match="nothing to save; pass all or some of maps, pictures"):
        output_options(save, None)
