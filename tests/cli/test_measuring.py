"""``occjax evaluate`` and ``occjax check``."""

import json

import imageio.v3 as imageio
import numpy as np
import pytest

from occjax.io import read_pfm, write_pfm


def test_errors_of_known_maps_are_printed(run, tmp_path):
    truth = np.zeros((60, 60), np.float32)
    estimate = truth.copy()
    estimate[15:45, 15:30] = 0.05  # half of the 30x30 pixels within the border
    write_pfm(tmp_path / "truth.pfm", truth)
    np.save(tmp_path / "estimate.npy", estimate)
    files = tmp_path / "estimate.npy", tmp_path / "truth.pfm"
    code, out, _ = run("evaluate", *files, "--border", 15)
    assert code == 0
    for line in ("MSE x100     0.125", "BadPix 0.07  0.000 %", "BadPix 0.03  50.000 %"):
        assert line in out
    code, out, _ = run("evaluate", *files, "--json")
    assert json.loads(out)["border"] == 7  # an eighth of 60 pixels
    np.testing.assert_allclose(json.loads(out)["badpix"]["0.03"], 100 * (30 * 15) / 46**2)


def test_a_map_compared_with_itself_causes_a_warning(run, scene):
    truth = scene / "gt_disp_lowres.pfm"
    code, out, err = run("evaluate", truth, scene)
    assert code == 0
    assert "BadPix 0.07  0.000 %" in out
    identical = f"{truth} and {truth} are identical, so all errors are 0; check the paths"
    assert err == f"occjax: warning: {identical}\n"


def test_published_scores_of_occcasnet_on_cotton(run, shared):
    folder = shared / "data/hci/cotton_maps"
    _, out, _ = run("evaluate", folder / "occcasnet_published.pfm", folder / "gt_disp_lowres.pfm")
    for published in ("0.263 %", "0.569 %", "3.057 %", "0.201"):
        assert published in out


@pytest.mark.parametrize("scene_first", [True, False])
def test_scene_folder_may_be_either_argument(run, scene, tmp_path, scene_first):
    truth = read_pfm(scene / "gt_disp_lowres.pfm")
    np.save(tmp_path / "estimate.npy", truth + np.float32(0.5))
    pair = (scene, tmp_path / "estimate.npy")
    code, out, err = run("evaluate", *(pair if scene_first else pair[::-1]), "--border", 2)
    assert (code, err) == (0, "")
    assert "MSE x100     25.000" in out


def test_measures_of_regions_and_missing_masks(run, scene, tmp_path):
    estimate = read_pfm(scene / "gt_disp_lowres.pfm")
    (scene / "masks").mkdir()
    mask = np.zeros(estimate.shape, np.uint8)
    mask[16, 16:20] = 255
    imageio.imwrite(scene / "masks/discontinuities.png", mask)
    estimate[16, 16] += 1.0  # one of four pixels
    np.save(tmp_path / "estimate.npy", estimate)
    code, out, _ = run("evaluate", "--metrics", "all", scene, tmp_path / "estimate.npy")
    assert code == 0
    assert ["discontinuities", "25.000", "%"] in [line.split() for line in out.splitlines()]
    assert "mask_fine_lowres.png" in out
    names = "discontinuities, badpix_0.5"
    code, out, _ = run("evaluate", "--metrics", names, scene, tmp_path / "estimate.npy", "--json")
    assert json.loads(out)["metrics"] == {
        "discontinuities": 25.0,
        "badpix_0.5": pytest.approx(100 / (2 * 10)),
    }


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--metrics", "fine_thinning"), "mask_fine_lowres.png"),
        (("--metrics", "thinness"), "thinness"),
        (("--metrics", " , "), "names no measure"),
        (
            ("--metrics", "mse_x100", "--thresholds", "0.2", "0.5"),
            "add badpix_0.2,badpix_0.5 to --metrics",
        ),
    ],
)
def test_measures_that_cannot_be_computed_are_one_line_and_code_2(run, scene, options, message):
    code, out, err = run("evaluate", *options, "--", scene, scene / "gt_disp_lowres.pfm")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err


def test_measures_of_regions_need_a_scene(run, scene):
    truth = scene / "gt_disp_lowres.pfm"
    code, _, err = run("evaluate", "--metrics", "all", truth, truth)
    assert code == 2
    assert "is the folder of a scene" in err


def test_the_missing_one_of_estimate_and_ground_truth_is_named(run, scene, tmp_path):
    for options in ((), ("--metrics", "all")):
        code, _, err = run("evaluate", scene, scene, *options)
        assert code == 2
        assert f"{scene}: is the folder of a scene; to compare an estimate with" in err
    (scene / "gt_disp_lowres.pfm").unlink()
    np.save(tmp_path / "estimate.npy", np.zeros((32, 40)))
    code, _, err = run("evaluate", tmp_path / "estimate.npy", scene)
    assert code == 2
    assert "pass the folder of a scene with gt_disp_lowres.pfm" in err


@pytest.mark.parametrize("options", [(), ("--metrics", "badpix_0.07")])
def test_an_estimate_of_another_view_is_refused(run, scene, result, corner_result, options):
    message = r"shows the view (0, 8), but {} shows the centre view; pass two maps of the same view"
    truth = scene / "gt_disp_lowres.pfm"
    for estimate in (corner_result, corner_result / "disparity.npy"):
        code, _, err = run("evaluate", estimate, scene, *options)
        assert code == 2
        assert message.format(truth) in err
    assert run("evaluate", result, scene, "--border", 2)[0] == 0


def test_a_map_is_compared_with_the_ground_truth_of_its_own_view(run, scene, result, corner_result):
    code, _, err = run("evaluate", corner_result, result)
    assert code == 2
    assert f"{result / 'disparity.pfm'} shows the centre view" in err
    truth = corner_result / "true.npy"  # a file of the user, which may be of any view
    np.save(truth, np.full((32, 40), 0.5))
    for folder in (corner_result, result):
        code, out, err = run("evaluate", folder, truth)
        assert code == 0, err
        assert "MSE x100     0.000" in out


def test_a_summary_of_another_program_says_nothing_on_the_view(run, scene, corner_result):
    (corner_result / "summary.json").write_text('{"view": [0, 8]}')
    code, _, err = run("evaluate", corner_result, scene)
    assert code == 0, err


def test_check_names_the_view_order_and_how_to_pass_it(run, scene):
    code, out, err = run("check", scene)
    assert (code, err) == (0, "")
    assert "view order: as declared" in out
    _, out, _ = run("check", scene, "--order", "uv")
    assert "rows and columns swapped; pass --order vu" in out


def test_one_view_is_too_few_and_its_option_is_named(run, scene):
    code, _, err = run("check", scene, "--views", 1, 1)
    assert code == 2
    assert (
        "has one view; disparity needs at least two; check grid and views (--grid, --views)" in err
    )
