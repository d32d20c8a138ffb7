"""The command line, in process: what it prints, writes and returns."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

import occjax
from occjax.cli import estimating
from occjax.io import read_pfm, write_pfm
from tests.scenes import plane


@pytest.fixture
def run(occjax_command):
    """Run ``occjax ARGUMENTS``; returns exit code, standard output and standard error."""
    return occjax_command


@pytest.fixture
def scene(tmp_path):
    """A folder in the layout of the HCI benchmark with ground truth, 9x9 views of 32x40."""
    folder = tmp_path / "scene"
    write_hci(folder, plane(grid=(9, 9), size=(32, 40), disparity=0.5))
    return folder


def write_hci(folder, light_field):
    folder.mkdir()
    views = (light_field.views * 255).round().astype(np.uint8).reshape(81, 32, 40, 3)
    for number, view in enumerate(views):
        imageio.imwrite(folder / f"input_Cam{number:03d}.png", view)
    write_pfm(folder / "gt_disp_lowres.pfm", light_field.ground_truth)


RANGE = ("--disparity-range", "-1", "2")


def test_estimate_writes_the_map_and_says_how_good_it_is(run, scene, tmp_path):
    code, out, err = run("estimate", scene, "-o", tmp_path / "out", *RANGE)
    assert (code, err) == (0, "")
    assert "BadPix 0.07" in out
    disparity = read_pfm(tmp_path / "out/scene/disparity.pfm")
    assert np.median(np.abs(disparity - 0.5)) < 0.03
    summary = json.loads((tmp_path / "out/scene/summary.json").read_text())
    assert summary["model"] == "light"
    assert summary["searched_disparity_range"] == [-1.0, 2.0]
    assert set(summary["seconds"]) == {"load", "compile", "run"}
    assert all(seconds > 0 for seconds in summary["seconds"].values())


def test_compiled_programs_are_kept_for_the_next_run(scene, tmp_path):
    # In processes of their own: JAX opens one cache for each process, at its first compilation.
    def run():
        estimate = ("estimate", scene, "-o", tmp_path / "out", "--model", "photometric", *RANGE)
        subprocess.run(
            [sys.executable, "-m", "occjax", *estimate],
            env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
            capture_output=True,
            check=True,
        )
        return {path.name for path in (tmp_path / "occjax/xla").glob("*photometric*-cache")}

    kept = run()
    assert kept
    assert run() == kept  # found again by the same key, not compiled under another


def test_one_bad_scene_does_not_stop_the_others(run, scene, tmp_path):
    broken = tmp_path / "broken"
    broken.mkdir()
    code, _, err = run("estimate", broken, scene, "-o", tmp_path / "out", *RANGE)
    assert code == 1
    assert "1 of 2 scenes failed" in err
    assert "Traceback" not in err
    assert (tmp_path / "out/scene/disparity.pfm").is_file()
    assert not (tmp_path / "out/broken").exists()


def test_scenes_of_the_same_name_do_not_overwrite_each_other(run, scene, tmp_path):
    other = tmp_path / "other" / "scene"
    other.parent.mkdir()
    write_hci(other, plane(grid=(9, 9), size=(32, 40), disparity=1.0))
    assert run("estimate", scene, other, "-o", tmp_path / "out", *RANGE)[0] == 0
    assert np.median(np.load(tmp_path / "out/scene/disparity.npy")) == pytest.approx(0.5, abs=0.05)
    second = np.load(tmp_path / "out/other_scene/disparity.npy")
    assert np.median(second) == pytest.approx(1.0, abs=0.05)


def test_names_of_the_result_folders(tmp_path):
    for name in ("one.npy", "one.npz", "two/scene/view.png", "three/scene/view.png"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "link").symlink_to(tmp_path / "two")
    scenes = [tmp_path / name for name in ("one.npy", "one.npz", "two/scene", "three/scene")]
    scenes += [tmp_path / "two" / ".." / "two" / "scene", tmp_path / "link"]
    names = estimating._folder_names(tuple(scenes))
    assert list(names.values()) == ["one", "one_npz", "scene", "three_scene", "link"]
    assert estimating._folder_names((Path("/"),)) == {Path("/"): "root"}


def test_an_unforeseen_failure_does_not_stop_the_other_scenes(run, scene, tmp_path, monkeypatch):
    write = estimating.write_outputs

    def fail_on_first(estimate, light_field, folder):
        if folder.name == "copy":
            raise RuntimeError("out of luck")
        return write(estimate, light_field, folder)

    monkeypatch.setattr(estimating, "write_outputs", fail_on_first)
    shutil.copytree(scene, tmp_path / "copy")
    code, out, err = run("estimate", tmp_path / "copy", scene, "-o", tmp_path / "out", *RANGE)
    assert code == 1
    assert "copy: RuntimeError: out of luck" in err
    assert "scene: light with light.safetensors" in out


def test_a_place_that_cannot_be_written_is_told_before_computing(run, scene, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(estimating.Estimator, "__call__", None)  # computing would fail
    code, _, err = run("estimate", scene, "-o", tmp_path / "file", *RANGE)
    assert code == 2
    assert str(tmp_path / "file") in err


def test_the_version_is_printed(run):
    code, out, _ = run("--version")
    assert (code, out) == (0, f"occjax {occjax.__version__}\n")


def test_a_reader_that_leaves_early_is_no_error(scene):
    command = f"'{sys.executable}' -m occjax check '{scene}' | head -1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("scene: 9x9 views")
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("estimate", "absent", "-o", "out"), "absent"),
        (("estimate", "-o", "out"), "name at least one scene"),
        (("estimate", "absent", "-o", "out", "--model", "occcasnet"), "needs weights"),
        (("evaluate", "absent.pfm", "truth.pfm"), "absent.pfm"),
        (("check", "absent"), "absent"),
    ],
)
def test_bad_input_is_one_line_and_code_2(run, arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = run(*arguments)
    assert code == 2
    assert err.count("\n") == 1
    assert message in err
    assert not (tmp_path / "out").exists()


def test_evaluate_prints_the_errors_of_known_maps(run, tmp_path):
    truth = np.zeros((60, 60), np.float32)
    estimate = truth.copy()
    estimate[15:45, 15:30] = 0.05  # half of the 30x30 pixels within the border
    write_pfm(tmp_path / "truth.pfm", truth)
    np.save(tmp_path / "estimate.npy", estimate)
    code, out, _ = run("evaluate", tmp_path / "estimate.npy", tmp_path / "truth.pfm")
    assert code == 0
    for line in ("MSE x100     0.125", "BadPix 0.07  0.000 %", "BadPix 0.03  50.000 %"):
        assert line in out
    code, out, _ = run("evaluate", tmp_path / "estimate.npy", tmp_path / "truth.pfm", "--json")
    assert json.loads(out)["badpix"]["0.03"] == 50.0


def test_the_cotton_column_of_the_paper_comes_out(run, shared):
    folder = shared / "data/hci/cotton_maps"
    _, out, _ = run("evaluate", folder / "occcasnet_published.pfm", folder / "gt_disp_lowres.pfm")
    for published in ("0.263 %", "0.569 %", "3.057 %", "0.201"):
        assert published in out


def test_check_names_the_right_layout_and_how_to_pass_it(run, scene):
    code, out, err = run("check", scene)
    assert (code, err) == (0, "")
    assert "layout: as declared" in out
    code, out, _ = run("check", scene, "--order", "uv")
    assert "rows and columns swapped; pass --order vu" in out


def test_estimate_warns_of_a_swapped_grid(run, scene, tmp_path):
    code, _, err = run("estimate", scene, "-o", tmp_path / "out", "--order", "uv", *RANGE)
    assert code == 0
    assert "occjax: warning: " in err
    assert "rows and columns swapped" in err
    summary = json.loads((tmp_path / "out/scene/summary.json").read_text())
    assert any("order" in note for note in summary["notes"])


def test_demo_measures_the_bundled_sample(run, tmp_path):
    code, out, err = run("demo", "-o", tmp_path / "demo")
    assert (code, err) == (0, "")
    assert "BadPix 0.07" in out
    assert str(tmp_path / "demo") in out
    assert (tmp_path / "demo/comparison.png").is_file()
    error = np.load(tmp_path / "demo/disparity.npy") - ground_truth_of_the_sample()
    assert np.median(np.abs(error)) < 0.07


def ground_truth_of_the_sample():
    from occjax.data.sample import sample

    return sample().ground_truth


def test_a_pool_is_rendered_and_says_how_to_train_on_it(run, tmp_path):
    scenes = ["--scenes.image-size", 16, 16, "--scenes.grid", 3, 3, "--scenes.views", "all"]
    few = ["--scenes.walls", 1, "--scenes.sheets", 1, "--scenes.solids", 1, "--no-photographs"]
    code, out, err = run("pool", tmp_path / "pool", "--count", 1, *scenes, *few)
    assert code == 0, err
    assert "1 light fields" in out
    assert f"--data.pools {tmp_path / 'pool'}" in out
    assert len(list((tmp_path / "pool").glob("*.npz"))) == 1


@pytest.mark.parametrize("scene_first", [True, False])
def test_a_scene_stands_for_its_ground_truth_in_either_place(run, scene, tmp_path, scene_first):
    truth = read_pfm(scene / "gt_disp_lowres.pfm")
    np.save(tmp_path / "estimate.npy", truth + np.float32(0.5))
    pair = (scene, tmp_path / "estimate.npy")
    code, out, err = run("evaluate", *(pair if scene_first else pair[::-1]), "--border", 2)
    assert (code, err) == (0, "")
    assert "MSE x100     25.000" in out


def test_evaluate_lists_what_the_scene_has_no_masks_for(run, scene, tmp_path):
    truth = read_pfm(scene / "gt_disp_lowres.pfm")
    (scene / "masks").mkdir()
    mask = np.zeros(truth.shape, np.uint8)
    mask[16, 16:20] = 255
    imageio.imwrite(scene / "masks/discontinuities.png", mask)
    estimate = truth.copy()
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
    ("metrics", "message"),
    [
        ("fine_thinning", "mask_fine_lowres.png"),
        ("thinness", "there is no measure 'thinness'"),
        (" , ", "names no measure"),
    ],
)
def test_a_measure_that_cannot_be_had_is_one_line_and_code_2(run, scene, metrics, message):
    truth = scene / "gt_disp_lowres.pfm"
    code, out, err = run("evaluate", "--metrics", metrics, scene, truth)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err


def test_thresholds_are_those_of_all_measures_and_not_of_named_ones(run, scene):
    truth = scene / "gt_disp_lowres.pfm"
    code, out, _ = run("evaluate", "--metrics", "all", "--thresholds", "0.2", "--", scene, truth)
    assert code == 0
    assert [line.split()[0] for line in out.splitlines() if "badpix" in line] == ["badpix_0.2"]
    code, out, err = run(
        "evaluate", "--metrics", "mse_x100", "--thresholds", "0.2", "0.5", "--", scene, truth
    )
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "add badpix_0.2,badpix_0.5 to --metrics" in err


def test_measures_of_regions_need_a_scene(run, scene):
    truth = scene / "gt_disp_lowres.pfm"
    code, _, err = run("evaluate", "--metrics", "all", truth, truth)
    assert code == 2
    assert "is a scene's folder" in err
