"""``occjax estimate`` and ``occjax demo``: files, reports and failures of single scenes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from occjax.cli import estimating
from occjax.data.bundled_sample import sample
from occjax.io import read_pfm

FAST = ("--model", "photometric", "--disparity-range", "-1", "2")


def test_estimate_writes_maps_and_reports_their_accuracy(run, scene, tmp_path):
    code, out, err = run("estimate", scene, "-o", tmp_path / "out", "--disparity-range", "-1", "2")
    assert (code, err) == (0, "")
    assert "scene: proposal with proposal.safetensors" in out
    assert "BadPix 0.07" in out
    disparity = read_pfm(tmp_path / "out/scene/disparity.pfm")
    assert np.median(np.abs(disparity - 0.5)) < 0.03
    assert (tmp_path / "out/scene/occlusion.png").is_file()
    summary = json.loads((tmp_path / "out/scene/summary.json").read_text())
    assert summary["model"] == "proposal"
    assert summary["searched_disparity_range"] == [-1.0, 2.0]
    assert set(summary["seconds"]) == {"load", "prepare", "compile", "run", "occlusion"}
    assert all(seconds > 0 for seconds in summary["seconds"].values())


@pytest.mark.slow
def test_compiled_programs_are_kept_for_the_next_run(scene, tmp_path):
    # In new processes: JAX opens one cache per process, at the first compilation.
    def run():
        estimate = ("estimate", scene, "-o", tmp_path / "out", *FAST)
        subprocess.run(
            [sys.executable, "-m", "occjax", *estimate],
            env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
            capture_output=True,
            check=True,
        )
        return {path.name for path in (tmp_path / "occjax/xla").glob("*-cache")}

    kept = run()
    assert kept
    assert run() == kept  # found by the same key, not compiled under another one


def test_failing_scenes_do_not_stop_the_others(run, scene, write_scene, tmp_path, monkeypatch):
    (tmp_path / "broken").mkdir()
    copy, write = write_scene(tmp_path / "copy"), estimating.write_outputs

    def fail_on_copy(estimate, light_field, folder):
        if folder.name == "copy":
            raise RuntimeError("out of luck")
        return write(estimate, light_field, folder)

    monkeypatch.setattr(estimating, "write_outputs", fail_on_copy)
    code, out, err = run(
        "estimate", tmp_path / "broken", copy, scene, "-o", tmp_path / "out", *FAST
    )
    assert code == 1
    assert "2 of 3 scenes failed" in err
    assert "copy: RuntimeError: out of luck" in err
    assert "Traceback" not in err
    assert "scene: photometric" in out
    assert (tmp_path / "out/scene/disparity.pfm").is_file()
    assert not (tmp_path / "out/broken").exists()


def test_scenes_of_one_name_have_different_folders(tmp_path):
    for name in ("one.npy", "one.npz", "two/scene/view.png", "three/scene/view.png"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "link").symlink_to(tmp_path / "two")
    scenes = [tmp_path / name for name in ("one.npy", "one.npz", "two/scene", "three/scene")]
    scenes += [tmp_path / "two" / ".." / "two" / "scene", tmp_path / "link"]
    names = estimating._folder_names(tuple(scenes))
    assert list(names.values()) == ["one", "one_npz", "scene", "three_scene", "link"]
    assert estimating._folder_names((Path("/"),)) == {Path("/"): "root"}


def test_folder_that_cannot_be_written_is_reported_before_computing(
    run, scene, tmp_path, monkeypatch
):
    (tmp_path / "file").touch()
    monkeypatch.setattr(estimating, "run_estimator", None)
    code, _, err = run("estimate", scene, "-o", tmp_path / "file", *FAST)
    assert code == 2
    assert str(tmp_path / "file") in err


def test_swapped_grid_causes_a_warning_and_a_note(run, scene, tmp_path):
    code, _, err = run("estimate", scene, "-o", tmp_path / "out", "--order", "uv", *FAST)
    assert code == 0
    assert "occjax: warning: " in err
    assert "rows and columns swapped" in err
    summary = json.loads((tmp_path / "out/scene/summary.json").read_text())
    assert any("rows and columns swapped" in note for note in summary["notes"])


@pytest.mark.slow
def test_demo_estimates_the_bundled_sample(run, tmp_path):
    code, out, err = run("demo", "-o", tmp_path / "demo")
    assert (code, err) == (0, "")
    assert "BadPix 0.07" in out
    assert str(tmp_path / "demo") in out
    assert (tmp_path / "demo/comparison.png").is_file()
    error = np.load(tmp_path / "demo/disparity.npy") - sample().ground_truth
    assert np.median(np.abs(error)) < 0.07
