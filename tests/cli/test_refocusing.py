"""``occjax refocus`` and ``occjax sweep``."""

import numpy as np
import pytest
from PIL import Image

from occjax.io import read_image
from occjax.lightfield import centre_index


def test_a_plane_is_sharp_at_the_disparity_of_its_pixel(run, scene, result, tmp_path):
    v, u = centre_index((9, 9))
    centre = read_image(scene / f"input_Cam{9 * v + u:03d}.png").astype(int)
    errors = {}
    for name, *options in (
        ("at", "--at", 10, 20, "--result", result),
        ("all", "--all-in-focus", "--result", result, "--aperture", 6),
        ("blurred", "--disparity", -0.5),
    ):
        code, out, err = run("refocus", scene, *options, "-o", tmp_path / f"{name}.png")
        assert code == 0, err
        picture = np.asarray(Image.open(tmp_path / f"{name}.png")).astype(int)
        errors[name] = np.abs(picture - centre)[4:-4, 4:-4].mean()
        if name == "at":
            assert "pixel 10 20: disparity 0.50" in out
    assert max(errors["at"], errors["all"]) < 0.25 * errors["blurred"]


def test_sweeps_of_focus_and_of_the_camera_are_videos(run, scene, tmp_path):
    code, out, _ = run("refocus", scene, "--sweep", -1, 1, 3, "-o", tmp_path / "focus.gif")
    assert (code, out.split(": ")[1]) == (0, "3 frames, focus from disparity -1 to 1\n")
    with Image.open(tmp_path / "focus.gif") as video:
        assert video.n_frames == 3
    code, out, _ = run("sweep", scene, "--path", "row", "-o", tmp_path / "row.webp")
    assert (code, out.split(": ")[1]) == (0, "16 views\n")
    with Image.open(tmp_path / "row.webp") as video:
        assert video.n_frames == 16


@pytest.mark.slow
def test_the_disparity_of_a_pixel_is_estimated(run, scene, tmp_path):
    code, out, err = run("refocus", scene, "--at", 10, 20, "-o", tmp_path / "at.png")
    assert code == 0, err
    assert float(out.split("disparity ")[1].split()[0]) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "pass one of --disparity"),
        (("--disparity", 1, "--all-in-focus"), "not --disparity and --all-in-focus"),
        (("--disparity", 1, "--aperture", -1), "--aperture is -1"),
        (("--disparity", 1, "--result", "folder"), "--result is only for --at"),
        (("--sweep", -1, 1, 1), "pass at least 2"),
        (("--sweep", -1, 1, 5), "needs the suffix .mp4"),
        (("--disparity", 1, "-o", "video.mp4"), "not the name of a picture"),
        (("--sweep", -1, 1, 5, "--fps", 0), "the rate is 0 frames"),
    ],
)
def test_wrong_options_are_explained_before_the_scene_is_read(run, arguments, message):
    code, _, err = run("refocus", "absent", "-o", "picture.png", *arguments)
    assert code == 2
    assert message in err


def test_pixels_outside_and_without_a_value_are_refused(run, scene, result):
    for place, message in (((32, 0), "rows are 0 to 31"), ((0, 0), "has no disparity")):
        code, _, err = run(
            "refocus", scene, "--at", *place, "--result", result, "-o", "picture.png"
        )
        assert code == 2
        assert message in err


@pytest.mark.parametrize("mode", [("--at", 10, 20), ("--all-in-focus",)])
def test_results_of_another_view_are_refused(run, scene, corner_result, mode):
    code, _, err = run("refocus", scene, *mode, "--result", corner_result, "-o", "picture.png")
    assert code == 2
    assert "is of the view (0, 8), but the light field scene is around the centre view" in err
