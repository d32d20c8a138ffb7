"""Handling of the renderer's process, with a fake renderer in place of Blender."""

import sys

import pytest

from experiments.blender import RenderConfig, find_blender, render_scene
from experiments.blender.__main__ import run
from experiments.blender.folder import view_name
from occjax.errors import InputError

CONFIG = RenderConfig(image_size=(8, 8), grid=(3, 3), samples=1)

RENDERER = f"""#!{sys.executable}
import json, pathlib, sys
job = json.loads(sys.argv[3])
folder, config = pathlib.Path(job["folder"]), job["config"]
(folder / "jobs.txt").open("a").write(" ".join(map(str, job["views"])) + chr(10))
if not (folder / "scene.json").exists():
    import numpy as np
    h, w = config["image_size"]
    depth = np.linspace(1.0, 2.0, h * w).reshape(h, w)
    np.savez(folder / "geometry.npz", depth=depth, objects=np.ones((h, w), int), facing=depth)
    rig = dict(focal_length_mm=50.0, sensor_size_mm=36.0, baseline_mm=9.0, focus_distance_m=1.5)
    record = dict(config=config, style="room", rig=rig, plain=[], glossy=[])
    (folder / "scene.json").write_text(json.dumps(record))
for number in job["views"]:
    if (folder / "stop").exists() and number == 5:
        sys.exit("out of memory")
    (folder / f"input_Cam{{number:03d}}.png").write_bytes(b"picture")
    print("view", number, flush=True)
"""


@pytest.fixture
def renderer(tmp_path):
    path = tmp_path / "python"
    path.write_text(RENDERER)
    path.chmod(0o755)
    return path


def test_all_views_are_rendered_and_reported(tmp_path, renderer):
    seen = []
    folder = render_scene(
        tmp_path / "scene", CONFIG, blender=renderer, progress=lambda *done: seen.append(done)
    )
    assert seen == [(number, 9) for number in range(1, 10)]
    assert (folder / view_name(8)).is_file()
    assert (folder / "gt_disp_lowres.pfm").is_file()
    assert (folder / "parameters.cfg").is_file()


def test_interrupted_rendering_resumes(tmp_path, renderer):
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "stop").touch()
    with pytest.raises(RuntimeError, match="out of memory"):
        render_scene(folder, CONFIG, blender=renderer)
    assert not (folder / "parameters.cfg").exists()
    (folder / "stop").unlink()
    seen = []
    render_scene(folder, CONFIG, blender=renderer, progress=lambda *done: seen.append(done))
    assert seen == [(number, 9) for number in range(6, 10)]
    assert (folder / "jobs.txt").read_text().splitlines() == ["0 1 2 3 4 5 6 7 8", "5 6 7 8"]


def test_finished_scene_is_not_rendered_again(tmp_path, renderer):
    render_scene(tmp_path / "scene", CONFIG, blender=renderer)
    render_scene(tmp_path / "scene", CONFIG, blender="/nowhere")


def test_folder_with_views_but_without_description_is_rejected(tmp_path, renderer):
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / view_name(0)).touch()
    with pytest.raises(InputError, match="another scene"):
        render_scene(folder, CONFIG, blender=renderer)


def test_missing_python_is_an_error(tmp_path):
    with pytest.raises(InputError, match="not a Python interpreter"):
        find_blender(tmp_path / "python")


def test_python_without_blender_is_an_error(tmp_path):
    empty = tmp_path / "empty"
    with pytest.raises(InputError, match="does not have bpy"):
        render_scene(empty, CONFIG, blender=_python_without_packages(tmp_path))


def test_message_without_blender_says_how_to_install_it(monkeypatch):
    monkeypatch.delenv("OCCJAX_BLENDER_PYTHON", raising=False)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match="pip install bpy"):
        find_blender()


def test_command_renders_a_folder_for_each_seed(tmp_path, renderer, capsys):
    run(tmp_path / "out", seeds=(2, 4), size=8, samples=1, grid=(3, 3), blender=renderer)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["s002", "s003"]
    assert len(capsys.readouterr().out.splitlines()) == 2


def test_command_rejects_an_empty_range_of_seeds(tmp_path):
    with pytest.raises(InputError, match="one past the last"):
        run(tmp_path, seeds=(4, 4))


def _python_without_packages(folder):
    """Return an interpreter that has the standard library only."""
    path = folder / "bare"
    path.write_text(f'#!/bin/sh\nexec "{sys.executable}" -S "$@"\n')
    path.chmod(0o755)
    return path
