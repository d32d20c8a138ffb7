"""Many scenes in one call of ``occjax estimate``: resumed, shared, interrupted, and as a video.

The estimator is a stub, and the scenes have one view, so that nothing is compiled.
"""

import csv
import errno
import json
import os
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path

import jax
import numpy as np
import pytest
from matplotlib import colormaps

from occjax.cli import scenes
from occjax.cli.pipelines import Pipelines
from occjax.cli.scene_lists import listed_scenes
from occjax.errors import InputError
from occjax.estimators import Estimate
from occjax.estimators.protocol import ModelInputs

CAMERA = (
    *("--focal-length-mm", 50, "--sensor-mm", 40),
    *("--baseline-mm", 20, "--focus-m", "inf"),
)
FILES = (
    *("centre.png", "confidence.npy", "disparity.npy", "disparity.pfm"),
    "standard_deviation.npy",
)


@dataclass(frozen=True)
class Brightness:
    """An estimator whose disparity is the red channel of the centre view."""

    variables: dict = field(default_factory=dict, compare=False)
    name: str = "brightness"

    def prepare(self, light_field, disparity_range):
        views = light_field.centre[..., 0].astype(np.float32)
        return ModelInputs(
            {}, views, (), disparity_range or light_field.disparity_range or (0.0, 1.0)
        )

    def run(self, variables, views):
        return views

    def finish(self, inputs, outputs):
        ones = np.ones_like(outputs)
        return Estimate(outputs, ones, ones, inputs.disparity_range, self.name)


@pytest.fixture
def estimator(monkeypatch):
    """The stub, which has taken the place of all models, and how many scenes it has estimated."""
    estimator, count = Brightness(), []
    monkeypatch.setattr("occjax.estimators.make_estimator", lambda *_, **__: estimator)
    estimate = scenes.run_estimator

    def counted(*arguments, **options):
        count.append(jax.config.jax_default_device)
        return estimate(*arguments, **options)

    monkeypatch.setattr(scenes, "run_estimator", counted)
    return estimator, count


@pytest.fixture
def folder(tmp_path):
    """Folder of three scenes of one view; their levels are 0.1, 0.2 and 0.3."""
    for number in (1, 2, 10):
        write_scene(tmp_path / "in" / f"scene{number}.npz", min(number, 3) / 10)
    return tmp_path / "in"


def write_scene(path, level, size=(6, 8)):
    path.parent.mkdir(exist_ok=True)
    views = np.full((1, 1, *size, 3), level, np.float32)
    np.savez(path, views=views, disparity_range=np.array([0.0, 1.0]))


def names(folder):
    return sorted(entry.relative_to(folder).as_posix() for entry in folder.rglob("*"))


def test_another_view_is_estimated_and_its_place_is_stored(run, tmp_path, estimator):
    levels = np.arange(9, dtype=np.uint8).reshape(3, 3) * 20 + 40
    views = np.broadcast_to(levels[..., None, None, None], (3, 3, 32, 32, 3))
    np.savez(tmp_path / "scene.npz", views=views, ground_truth=np.zeros((32, 32), np.float32))
    call = (
        "estimate",
        tmp_path / "scene.npz",
        "-o",
        tmp_path,
        "--save",
        "maps",
        "--view",
        "0",
        "2",
    )
    assert run(*call)[0] == 0
    folder = tmp_path / "scene"
    assert (np.load(folder / "disparity.npy") == levels[0, 2]).all()
    assert not (folder / "ground_truth.npy").exists()
    again = Estimate.load(folder)
    assert again.light_field.view == (0, 2)
    assert (again.light_field.centre == levels[0, 2]).all()
    assert "skipped" in run(*call)[1]
    code, _, err = run(*call[:-2], "0", "3")
    assert (code, "there is no view (0, 3)" in err) == (2, True)


def test_a_second_call_skips_what_is_complete_with_the_same_settings(
    run, folder, tmp_path, estimator
):
    _, estimated = estimator

    def again(*options, scene=folder):
        estimated.clear()
        code, out, err = run("estimate", scene, "-o", tmp_path / "out", "--save", "maps", *options)
        assert code == 0, err
        return len(estimated), out

    assert again()[0] == 3
    count, out = again()
    assert count == 0
    assert "3 of 3 scenes are complete with the same settings and skipped" in out
    assert again("--overwrite")[0] == 3
    others = (*CAMERA, "--disparity-range", "0", "2")
    assert again(*others)[0] == 3
    assert again(*others)[0] == 0
    assert again()[0] == 3
    # Only what has changed is estimated: the files of a scene, or the results.
    write_scene(folder / "scene2.npz", 0.5)
    (tmp_path / "out/scene10/confidence.npy").unlink()
    assert again()[0] == 2
    np.testing.assert_allclose(np.load(tmp_path / "out/scene2/disparity.npy"), 0.5)
    (tmp_path / "out/scene1/summary.json").write_text("{")
    assert again()[0] == 1
    estimator[0].variables["kernel"] = np.ones(2, np.float32)  # other weights
    assert again()[0] == 3
    assert "scene1 is complete" in again(scene=folder / "scene1.npz")[1]
    settings = json.loads((tmp_path / "out/scene1/summary.json").read_text())["settings"]
    assert settings["options"]["save"] == ["maps"]


def test_the_table_has_scores_failures_and_times(run, folder, tmp_path, estimator):
    np.savez(
        folder / "scene1.npz", views=np.full((1, 1, 40, 40, 3), 0.5), ground_truth=np.ones((40, 40))
    )
    (folder / "scene3.npz").write_text("no array")
    code, _, err = run("estimate", folder, "-o", tmp_path / "out", "--save", "maps")
    assert code == 1
    assert "1 of 4 scenes failed" in err
    with (tmp_path / "out/scenes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["scene"] for row in rows] == ["scene1", "scene2", "scene3", "scene10"]
    assert [row["state"] for row in rows] == ["complete", "complete", "failed", "complete"]
    assert float(rows[0]["mse_x100"]) == pytest.approx(25.0)
    assert float(rows[0]["badpix_0.07"]) == 100.0
    assert rows[1]["mse_x100"] == ""
    assert "scene3.npz" in rows[2]["error"]
    stored = json.loads((tmp_path / "out/scenes.json").read_text())
    assert [entry["source"] for entry in stored] == [row["source"] for row in rows]
    assert stored[0]["seconds"] > 0


def test_processes_share_the_scenes_and_the_last_one_completes_the_table(
    run, folder, tmp_path, estimator
):
    _, estimated = estimator
    (tmp_path / "list.txt").write_text(f"{folder}\n")
    given = ("--scenes-from", tmp_path / "list.txt", "-o", tmp_path / "out")
    share = ("estimate", *given, "--save", "maps", "--share")
    (folder / "scene5.npz").write_text("no array")
    assert run(*share, 0, 2)[0] == 1
    table = json.loads((tmp_path / "out/scenes.json").read_text())
    assert [row["state"] for row in table] == ["complete", "missing", "failed", "missing"]
    assert run(*share, 1, 2)[0] == 0
    assert len(estimated) == 3
    table = json.loads((tmp_path / "out/scenes.json").read_text())
    assert [row["state"] for row in table] == ["complete", "complete", "failed", "complete"]
    code, _, err = run(*share, 2, 2)
    assert code == 2
    assert "from 0 to 1" in err


@pytest.mark.parametrize("full", ["disparity.npy", "summary.json"])
def test_a_full_disk_stops_the_command_after_the_first_scene(
    run, folder, tmp_path, estimator, monkeypatch, full
):
    _, estimated = estimator
    save, dumps = np.save, json.dumps

    def fill(name):
        if name == full and len(estimated) >= 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(np, "save", lambda path, array: fill(path.name) or save(path, array))
    monkeypatch.setattr(
        "occjax.results.outputs.json.dumps",
        lambda *given, **options: fill("summary.json") or dumps(*given, **options),
    )
    for number in range(20, 30):
        write_scene(folder / f"scene{number}.npz", 0.5)
    code, _, err = run("estimate", folder, "-o", tmp_path / "out", "--save", "maps")
    assert code == 2
    lines = [line for line in err.splitlines() if line.startswith("occjax")]
    assert len(lines) == 1
    assert "cannot be written (no space left on device); scenes written: " in lines[0]
    assert "Traceback" not in err
    assert len(estimated) <= 8  # of 13: each of the two devices may have begun a few more
    left = names(tmp_path / "out")
    assert not [name for name in left if name.startswith(".")]
    assert "scene10/summary.json" not in left


def test_remains_of_a_killed_process_are_removed(run, folder, tmp_path, estimator):
    script = (
        "import os, sys; from occjax.io.atomic import atomic_folder, atomic_path; "
        "a = atomic_folder(sys.argv[1] + '/scene1'); (a.__enter__() / 'disparity.npy').touch(); "
        "b = atomic_path(sys.argv[1] + '/scenes.csv'); b.__enter__().touch(); "
        "os.makedirs(sys.argv[1] + '/scene2'); c = atomic_folder(sys.argv[1] + '/scene2'); "
        "c.__enter__(); os.kill(os.getpid(), 9)"
    )
    out = tmp_path / "out"
    subprocess.run([sys.executable, "-c", script, out], check=False)
    assert len([name for name in names(out) if "/." in f"/{name}"]) == 4
    (out / ".mine.txt").touch()
    code, _, _ = run("estimate", folder, "-o", out, "--save", "maps")
    assert code == 0
    assert [name for name in names(out) if "/." in f"/{name}"] == [".mine.txt"]
    assert names(out / "scene1") == [*FILES, "summary.json"]


INTERRUPTED = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
from tests.cli.test_scenes import Brightness
import occjax.estimators
from occjax.cli import main
class Endless(Brightness):
    def prepare(self, light_field, disparity_range):
        if light_field.name == "scene2":
            print("begins", flush=True)
            time.sleep(600)
        return super().prepare(light_field, disparity_range)
occjax.estimators.make_estimator = lambda *_, **__: Endless()
main()
"""


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interruption_ends_the_command_and_keeps_what_is_complete(folder, tmp_path, number, code):
    command = ["estimate", folder, "-o", tmp_path / "out", "--save", "maps"]
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, *command],
        env=os.environ | {"XLA_FLAGS": ""},  # one device: the scenes follow each other
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    # Another thread may print within the line.
    assert any("begins" in line for line in process.stdout)
    process.send_signal(number)
    _, err = process.communicate(timeout=120)  # not the 600 s of the scene
    assert process.returncode == code
    assert "interrupted; scenes written: 1;" in err
    assert "Traceback" not in err
    assert names(tmp_path / "out") == ["scene1", *(f"scene1/{n}" for n in (*FILES, "summary.json"))]


@pytest.mark.parametrize(("count", "promised"), [(1, False), (2, True)])
def test_only_of_several_scenes_an_interruption_leaves_others(count, promised, monkeypatch, capsys):
    steps = dict.fromkeys(("read", "estimate", "write"), print)
    scene_names = {Path(f"scene{number}"): f"scene{number}" for number in range(count)}
    monkeypatch.setattr(os, "_exit", sys.exit)
    with pytest.raises(SystemExit):
        Pipelines(scene_names, **steps, single_scene=count == 1).abandon(130)
    err = capsys.readouterr().err
    assert "occjax: interrupted; scenes written: 0" in err
    assert ("the same command estimates the others" in err) == promised


def test_scenes_are_estimated_on_all_devices_at_the_same_time(
    run, folder, tmp_path, estimator, monkeypatch
):
    devices = jax.local_devices()[:2]
    if len(devices) < 2:
        pytest.skip("needs two devices, which the tests simulate by XLA_FLAGS")
    both = threading.Barrier(2)
    prepare = Brightness.prepare

    def wait_for_the_other(self, light_field, disparity_range):
        if light_field.name != "scene10":
            both.wait(60)
        return prepare(self, light_field, disparity_range)

    monkeypatch.setattr(Brightness, "prepare", wait_for_the_other)
    code, _, err = run("estimate", folder, "-o", tmp_path / "out", "--save", "maps")
    assert code == 0, err
    assert set(estimator[1]) == set(devices)
    for name, level in (("scene1", 0.1), ("scene2", 0.2), ("scene10", 0.3)):
        np.testing.assert_allclose(np.load(tmp_path / "out" / name / "disparity.npy"), level)


def test_a_video_has_numbered_frames_of_one_range_and_one_colour_scale(
    run, folder, tmp_path, estimator, monkeypatch, tolerance
):
    pytest.importorskip("imageio_ffmpeg")
    drawn = []
    monkeypatch.setattr(
        "occjax.cli.frames.write_video",
        lambda path, frames, frames_per_second: drawn.extend([frames_per_second, *frames]),
    )
    code, out, err = run("estimate", "--video", folder, "-o", tmp_path / "out", "--fps", "30")
    assert code == 0, err
    levels = [np.load(tmp_path / f"out/{n:04d}/disparity.npy")[0, 0] for n in range(3)]
    np.testing.assert_allclose(levels, (0.1, 0.2, 0.3))
    assert drawn[0] == 30.0
    colours = [tuple(frame[0, 0]) for frame in drawn[1:]]
    # The range of a map of one value is that value and half a pixel on both sides.
    for colour, level in zip(colours, (0.1, 0.2, 0.3), strict=True):
        expected = colormaps["viridis"]((level + 0.4) / 1.2, bytes=True)[:3]
        np.testing.assert_allclose(colour, expected, **tolerance("colour"))
    assert "3 frames written to" in out
    write_scene(folder / "scene11.npz", 0.4, size=(6, 10))
    code, _, err = run("estimate", "--video", folder, "-o", tmp_path / "out")
    assert code == 1
    assert "all frames need the same" in err
    assert len(drawn) == 4 + 1 + 4  # the frame that failed shows the one before
    code, _, err = run("estimate", "--video", folder, "-o", tmp_path, "--save", "cloud")
    assert code == 2
    assert "add maps" in err


def test_lists_of_scenes_are_folders_patterns_and_files(tmp_path, monkeypatch):
    for name in ("set/b10/x.png", "set/b9/x.png", "set/b9/y.npy", "arrays/a.npz", "arrays/b.npy"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)

    def listed(*given, file=None, **options):
        return [str(path) for path in listed_scenes(tuple(map(Path, given)), file, **options)]

    assert listed("set") == ["set/b9", "set/b10"]
    assert listed("set/b9") == ["set/b9"]
    assert listed("set", expand_folders=False) == ["set"]
    assert listed("arrays", "set/b*") == ["arrays/a.npz", "arrays/b.npy", "set/b9", "set/b10"]
    Path("arrays/c").mkdir()  # a folder of scenes may hold arrays and folders
    assert listed("arrays") == ["arrays/a.npz", "arrays/b.npy", "arrays/c"]
    Path("list.txt").write_text("# scenes\nset/b10\n\narrays/*.npz\n")
    assert listed("set/b10", file=Path("list.txt")) == ["set/b10", "arrays/a.npz"]
    with pytest.raises(InputError, match="nothing matches"):
        listed("set/c*")
    Path("empty.txt").write_text("\n")
    with pytest.raises(InputError, match="lists no scene"):
        listed(file=Path("empty.txt"))
