"""All measures by name: each uses its own region and reports missing files."""

import json

import imageio.v3 as imageio
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.evaluation import evaluate_scene, metric_names
from occjax.io import write_pfm

PARAMETERS = """[intrinsics]
focal_length_mm = 100.0
sensor_size_mm = 35.0
[extrinsics]
baseline_mm = 50.0
focus_distance_m = 7.0
"""

REGIONS = {
    "discontinuities": ("discontinuities", "discontinuities_mse_x100"),
    "fine_surrounding": ("fine_fattening",),
    "fine": ("fine_thinning",),
    "foreground_fattening": ("backgammon_fattening",),
    "foreground_thinning": ("backgammon_thinning",),
    "low_texture": ("stripes_low_texture",),
    "high_contrast": ("stripes_dark",),
    "low_contrast": ("stripes_bright",),
}
"""Regions in which an error counts, and the measures that use them."""

SMOOTH = {
    "planes": ("bumpiness_planes", "normals_planes_median", "normals_planes_mean"),
    "smooth_surfaces": ("bumpiness_smooth", "normals_smooth_median", "normals_smooth_mean"),
    "plane": ("pyramids_bumpiness_parallel",),
    "pyramids": ("pyramids_bumpiness_slanted",),
    "sphere_in": ("pyramids_bumpiness_slanted",),
    "sphere_out": ("pyramids_bumpiness_slanted",),
}
"""The same for measures of smooth surfaces."""

OTHERS = ("foreground", "background", "dots_by_size")

NAMES = (*REGIONS, *SMOOTH, *OTHERS)


def region(name):
    """Each region has its own five rows of a map of 120 rows and 40 columns."""
    mask = np.zeros((120, 40), bool)
    top = 15 + 5 * NAMES.index(name)
    mask[top : top + 5] = True
    return mask


@pytest.fixture
def scene(tmp_path):
    """A scene with every mask, whose foreground is at 1 and everything else at 0."""
    folder = tmp_path / "scene"
    folder.mkdir()
    truth = region("foreground").astype(np.float32) + region("foreground_thinning")
    write_pfm(folder / "gt_disp_lowres.pfm", truth.astype(np.float32))
    (folder / "parameters.cfg").write_text(PARAMETERS)
    for name in NAMES:
        write_mask(folder, name, region(name))
    return folder, truth


def write_mask(folder, name, mask):
    imageio.imwrite(folder / f"mask_{name}_lowres.png", (255 * mask).astype(np.uint8))


def saved(folder, estimate):
    path = folder.parent / "estimate.npy"
    np.save(path, estimate)
    return path


def test_ground_truth_is_perfect_in_every_measure(scene):
    folder, truth = scene
    results = folder.parent / "results"
    results.mkdir()
    write_pfm(results / "disparity.pfm", truth.astype(np.float32))
    (results / "summary.json").write_text('{"seconds": {"run": 2.5}}')
    scores = evaluate_scene(folder, results)
    assert scores.scene == "scene"
    assert scores.missing == {}
    assert tuple(scores.values) == metric_names()
    assert scores.values.pop("runtime") == 2.5
    assert set(scores.values.values()) == {0.0}


@pytest.mark.parametrize("name", REGIONS)
def test_error_in_a_region_affects_its_measures_only(scene, name):
    folder, truth = scene
    sign = -1.0 if "thinning" in name or name == "fine" else 1.0
    estimate = truth + 0.9 * sign * region(name)
    scores = evaluate_scene(folder, saved(folder, estimate)).values
    seen = {metric for measures in REGIONS.values() for metric in measures if scores[metric]}
    assert seen == set(REGIONS[name])
    # Nine tenths of the way to the other layer, over all of the region's pixels.
    for metric in seen:
        assert scores[metric] == pytest.approx(81.0 if "mse" in metric else 100.0)


@pytest.mark.parametrize("name", SMOOTH)
def test_bend_in_a_region_affects_its_measures_only(scene, name):
    folder, truth = scene
    x = np.arange(40.0)
    # Only in the middle row of the five, whose neighbours are of the same region.
    row = 17 + 5 * NAMES.index(name)
    estimate = truth.copy()
    estimate[row] += 0.02 * (x % 2)
    scores = evaluate_scene(folder, saved(folder, estimate)).values
    surfaces = {metric for measures in SMOOTH.values() for metric in measures}
    seen = {metric for metric in surfaces if "median" not in metric and scores[metric]}
    assert seen == {metric for metric in SMOOTH[name] if "median" not in metric}


def test_dots_and_their_background(scene):
    folder, truth = scene
    dots = np.zeros(truth.shape, bool)
    top = 15 + 5 * NAMES.index("dots_by_size")
    for left in (16, 18, 20, 22):
        dots[top + 2, left] = True
    write_mask(folder, "dots_by_size", dots)
    estimate = truth + 0.3 * region("background")
    estimate[top + 2, 18] = 0.5
    names = ("dots_missed", "dots_background_mse_x100")
    scores = evaluate_scene(folder, saved(folder, estimate), names=names)
    assert scores.values == {
        "dots_missed": 25.0,
        "dots_background_mse_x100": pytest.approx(9.0),
    }


def test_tilt_is_measured_in_degrees(scene, tolerance):
    folder, truth = scene
    # A wall at the focus, tilted by 30 degrees: z = 7 / (1 + tan(30) x / f) has disparity
    # f b (1/z - 1/7) = b tan(30) x / 7, the shift of the camera in the units of x.
    slope = 0.050 * np.tan(np.radians(30.0)) / 7.0
    estimate = truth + slope * (np.arange(40.0) - 19.5)
    names = ("normals_planes_median", "normals_smooth_mean")
    scores = evaluate_scene(folder, saved(folder, estimate), names=names)
    np.testing.assert_allclose(list(scores.values.values()), [30.0, 30.0], **tolerance("relative"))


def test_missing_files_are_listed(scene):
    folder, truth = scene
    (folder / "mask_planes_lowres.png").unlink()
    (folder / "mask_dots_by_size_lowres.png").unlink()
    write_mask(folder, "fine", np.zeros(truth.shape, bool))
    scores = evaluate_scene(folder, saved(folder, truth))
    assert scores.missing == {
        "runtime": "summary.json",
        "bumpiness_planes": "mask_planes_lowres.png",
        "normals_planes_median": "mask_planes_lowres.png",
        "normals_planes_mean": "mask_planes_lowres.png",
        "fine_thinning": "a valid pixel of fine inside the border",
        "dots_missed": "mask_dots_by_size_lowres.png",
        "dots_background_mse_x100": "mask_dots_by_size_lowres.png",
    }
    assert set(scores.values) | set(scores.missing) == set(metric_names())
    table = scores.table()
    for name in ("bumpiness_planes", "normals_planes_median", "normals_planes_mean"):
        line = next(line for line in table.splitlines() if name in line)
        assert line.split()[0] == "mask_planes_lowres.png"
    assert json.loads(json.dumps(scores.as_dict(), allow_nan=False)) == {
        "scene": "scene",
        "metrics": scores.values,
        "not_measured": scores.missing,
        "border": 15,
    }


def test_without_calibration_only_normals_are_missing(scene):
    folder, truth = scene
    (folder / "parameters.cfg").unlink()
    missing = evaluate_scene(folder, saved(folder, truth)).missing
    lacking = {name for name, file in missing.items() if file == "parameters.cfg"}
    assert lacking == {name for name in metric_names() if name.startswith("normals")}


def test_missing_file_of_a_measure_given_by_name_is_an_error(scene):
    folder, truth = scene
    (folder / "mask_planes_lowres.png").unlink()
    message = (
        r"bumpiness_planes cannot be measured: .*mask_planes_lowres.png: there is no such mask"
    )
    with pytest.raises(InputError, match=message) as caught:
        evaluate_scene(folder, saved(folder, truth), names=("mse_x100", "bumpiness_planes"))
    assert "\n" not in str(caught.value)


def test_badpix_accepts_any_threshold(scene):
    folder, truth = scene
    estimate = saved(folder, truth + 0.05)
    scores = evaluate_scene(folder, estimate, names=("badpix_0.06", "badpix_0.04"))
    assert scores.values == {"badpix_0.06": 0.0, "badpix_0.04": 100.0}
    scores = evaluate_scene(folder, estimate, thresholds=(0.2,))
    assert [name for name in scores.values if name.startswith("badpix")] == ["badpix_0.2"]


@pytest.mark.parametrize("name", ["nothing", "badpix_", "badpix_x", "badpix_nan", "", "mask"])
def test_unknown_measure_is_refused_with_known_ones(scene, name):
    folder, truth = scene
    with pytest.raises(
        InputError, match=r"there is no measure .*('fine_thinning'|did you mean 'badpix_0.07')"
    ):
        evaluate_scene(folder, saved(folder, truth), names=(name,))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda truth: truth[1:], r"estimate.npy against .*gt_disp_lowres.pfm: estimate is \[119"),
        (lambda truth: np.full_like(truth, np.nan), r"mse_x100 of .*estimate.npy .*finite value"),
    ],
)
def test_estimate_that_does_not_fit_is_named(scene, change, message):
    folder, truth = scene
    with pytest.raises(InputError, match=message):
        evaluate_scene(folder, saved(folder, change(truth)))


def test_folder_without_ground_truth_is_named(tmp_path):
    with pytest.raises(InputError, match=r"gt_disp_lowres.pfm: there is no such file"):
        evaluate_scene(tmp_path, tmp_path)
