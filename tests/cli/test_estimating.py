"""``occjax estimate`` and ``occjax demo``: files, reports and failures of single scenes."""

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import jax
import numpy as np
import pytest

from occjax.cli import scenes
from occjax.cli.options import ViewOrderOptions
from occjax.cli.scene_lists import folder_names
from occjax.data.bundled_sample import sample
from occjax.io import read_pfm

CAMERA = (
    *("--focal-length-mm", 50, "--sensor-mm", 40),
    *("--baseline-mm", 20, "--focus-m", "inf"),
)
FAST = ("--model", "photometric", "--disparity-range", "-1", "2")


def test_estimate_writes_maps_and_reports_their_accuracy(run, scene, tmp_path, tolerance):
    # The scene after the two numbers is not taken for a third one.
    code, out, err = run(
        "estimate", "-o", tmp_path / "out", *CAMERA, "--disparity-range", "-1", "2", scene
    )
    assert code == 0
    phases = ["reading", "preparing", "loading the program", "estimating", "writing"]
    lines = err.splitlines()  # there is no terminal: one line for each phase
    assert [line for line in lines if "compiling" not in line] == [f"scene: {p}" for p in phases]
    assert "scene: proposal with proposal.safetensors" in out
    assert "BadPix 0.07" in out
    disparity = read_pfm(tmp_path / "out/scene/disparity.pfm")
    assert np.median(np.abs(disparity - 0.5)) < 0.03
    assert {path.name for path in (tmp_path / "out/scene").iterdir()} == {
        *("disparity.pfm", "disparity.npy", "confidence.npy", "disparity_picture.png"),
        *("confidence.png", "error.png", "points.ply", "summary.json", "depth.npy"),
        *("standard_deviation.npy", "ground_truth.npy", "centre.png"),
    }
    # Parallel cameras: depth = f b / d, with f = 50 / 40 of 40 pixels and b = 20 mm.
    depth = np.load(tmp_path / "out/scene/depth.npy")
    np.testing.assert_allclose(depth, 50 * 0.02 / disparity, **tolerance("relative"))
    summary = json.loads((tmp_path / "out/scene/summary.json").read_text())
    assert summary["model"] == "proposal"
    assert summary["calibration"] == {
        "focal_length_mm": 50.0,
        "sensor_size_mm": 40.0,
        "baseline_mm": 20.0,
        "focus_distance_m": None,
    }
    converted = tmp_path / "depth.pfm"
    code, out, _ = run("convert", tmp_path / "out/scene", converted, "--to", "depth")
    assert code == 0
    assert f"camera: {tmp_path / 'out/scene/summary.json'}" in out
    np.testing.assert_allclose(read_pfm(converted), depth, **tolerance("relative"))
    assert summary["searched_disparity_range"] == [-1.0, 2.0]
    assert set(summary["seconds"]) == {"load", "prepare", "compile", "run"}
    assert all(seconds > 0 for seconds in summary["seconds"].values())


TRACES = """
import sys, jax
from occjax.cli import main
traced = []
def listen(event, seconds, **_):
    if event == "/jax/core/compile/jaxpr_trace_duration":
        traced.append(event)
jax.monitoring.register_event_duration_secs_listener(listen)
try:
    main()
finally:
    print(f"traced {len(traced)}; {[m for m in ('flax', 'matplotlib.figure') if m in sys.modules]}")
"""
"""The command line, and the number of functions that JAX traces for it."""


@pytest.mark.slow
def test_a_second_run_of_one_shape_traces_nothing(scene, tmp_path, monkeypatch):
    # If the user configures JAX's own cache, as the tests do for child processes, nothing is kept.
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")

    def run():
        arguments = ("estimate", scene, "-o", tmp_path / "out", "--overwrite", *FAST)
        done = subprocess.run(
            [sys.executable, "-c", TRACES, *arguments],
            env=os.environ | {"XDG_CACHE_HOME": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.splitlines()[-1]

    assert not run().startswith("traced 0;")
    first = (tmp_path / "out/scene/disparity.npy").read_bytes()
    assert run() == "traced 0; []"
    assert (tmp_path / "out/scene/disparity.npy").read_bytes() == first


def test_only_what_is_asked_for_is_computed_and_written(run, scene, tmp_path, monkeypatch):
    monkeypatch.setattr("occjax.estimators.driver.estimate_occlusion", None)  # would fail
    code, _, err = run("estimate", scene, "-o", tmp_path, *FAST, "--save", "cloud")
    assert (code, "occlusion" in err) == (0, False)
    written = {path.name for path in (tmp_path / "scene").iterdir()} - {"input_Cam"}
    assert {name for name in written if not name.startswith(("input", "gt"))} == {
        "points.ply",
        "summary.json",
    }
    code, _, err = run("estimate", scene, "-o", tmp_path, "--save", "clouds")
    assert code == 2
    assert "'clouds' is no group of files; did you mean 'cloud'?" in err


def test_the_next_scene_is_read_while_one_is_estimated(run, write_scene, tmp_path, monkeypatch):
    names = ["c", "a", "b"]
    places = [write_scene(tmp_path / name) for name in names]
    (tmp_path / "broken").mkdir()
    order = (places[0], tmp_path / "broken", *places[1:])
    began = [threading.Event() for _ in order]
    read, estimate = ViewOrderOptions.load, scenes.run_estimator

    def recorded_read(view_order, scene):
        began[order.index(scene)].set()
        return read(view_order, scene)

    def recorded_estimate(estimator, light_field, **options):
        number = [place.name for place in order].index(light_field.name)
        if number + 1 < len(order):
            assert began[number + 1].wait(60)
        assert not any(event.is_set() for event in began[number + 2 :])
        return estimate(estimator, light_field, **options)

    monkeypatch.setattr(ViewOrderOptions, "load", recorded_read)
    monkeypatch.setattr(scenes, "run_estimator", recorded_estimate)
    devices = jax.local_devices()[:1]
    monkeypatch.setattr(jax, "local_devices", lambda *_, **__: devices)
    code, out, err = run("estimate", *order, "-o", tmp_path / "out", *FAST)
    assert code == 1
    reports = [line.split(":")[0] for line in out.splitlines() if not line.startswith(" ")]
    assert reports == names
    assert "1 of 4 scenes failed" in err


@pytest.mark.parametrize(
    ("view", "options", "reason"),
    [
        ("input_Cam040.png", (), "input_Cam040.png (row 4, column 4 of the 9x9 grid, counted from"),
        ("input_Cam000.png", ("--view", 0, 0), "the view (0, 0) is missing or too dark"),
    ],
)
def test_a_damaged_view_is_named_as_the_cause(run, scene, tmp_path, view, options, reason):
    (scene / view).write_text("text")
    code, _, err = run("estimate", scene, "-o", tmp_path / "out", *FAST, *options)
    assert code == 2
    warning, error = err.splitlines()[-2:]
    assert warning.startswith(f"occjax: warning: {scene / view}: cannot be decoded as an image")
    assert reason in error


def test_failing_scenes_do_not_stop_the_others(run, scene, write_scene, tmp_path, monkeypatch):
    (tmp_path / "broken").mkdir()
    copy, write = write_scene(tmp_path / "copy"), scenes.write_outputs

    def fail_on_copy(estimate, light_field, folder, options, **command):
        if folder.name == "copy":
            raise RuntimeError("out of luck")
        return write(estimate, light_field, folder, options, **command)

    monkeypatch.setattr(scenes, "write_outputs", fail_on_copy)
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
    places = [tmp_path / name for name in ("one.npy", "one.npz", "two/scene", "three/scene")]
    places += [tmp_path / "two" / ".." / "two" / "scene", tmp_path / "link"]
    names = folder_names(tuple(places))
    assert list(names.values()) == ["one", "one_npz", "scene", "three_scene", "link"]
    assert folder_names((Path("/"),)) == {Path("/"): "root"}


def test_folder_that_cannot_be_written_is_reported_before_computing(
    run, scene, tmp_path, monkeypatch
):
    (tmp_path / "file").touch()
    monkeypatch.setattr(scenes, "run_estimator", None)
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
def test_demo_estimates_the_bundled_sample_and_opens_the_viewer(run, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(
        "occjax.cli.viewing.view_command", lambda results: opened.extend(results) or 0
    )
    code, out, err = run("demo", "-o", tmp_path / "demo", "--view")
    assert opened == [tmp_path / "demo"]
    assert code == 0
    assert "warning" not in err
    assert "BadPix 0.07" in out
    assert str(tmp_path / "demo") in out
    assert (tmp_path / "demo/comparison.png").is_file()
    error = np.load(tmp_path / "demo/disparity.npy") - sample().ground_truth
    assert np.median(np.abs(error)) < 0.07
