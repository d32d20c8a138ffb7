"""Smoke test of the contact sheet, its text and its colours."""

from functools import partial

import imageio.v3 as imageio
import numpy as np
import pytest

from experiments import real_scenes
from experiments.cut_outs import cut_out
from experiments.real_scenes import Band, Outcome, sheet
from occjax.viz import save
from occjax.viz.colour import confidence_colours, disparity_colours
from tests.scenes import plane


@pytest.fixture
def run(script):
    """Return a function that runs the script."""
    return partial(script, real_scenes.run)


def pixels(figure, tmp_path):
    """Return the pixels ``[H, W, 3]`` of the saved figure."""
    save(figure, tmp_path / "sheet.png")
    return imageio.imread(tmp_path / "sheet.png")[..., :3].astype(int)


def count(picture, colour, tolerance=2):
    """Count the pixels of a colour."""
    return int((np.abs(picture - np.asarray(colour)) <= tolerance).all(-1).sum())


def test_disparities_of_all_estimators_have_common_colours(tmp_path):
    certain = np.ones((40, 40))
    centre = np.broadcast_to(np.array([250, 20, 90], np.uint8), (40, 40, 3))
    outcomes = (
        Outcome("near", np.full((40, 40), 1.0), certain, 1.26),
        Outcome("ramp", np.tile(np.linspace(-1.0, 0.9, 40), (40, 1)), certain, 20.0),
    )
    figure = sheet([Band("lab: 3x3 views", centre, outcomes)], "A note.")
    titles = ["lab: 3x3 views", "near: 1.3 s", "ramp: 20.0 s"]
    titles += ["", "near: confidence", "ramp: confidence", "A note."]
    assert [text.get_text() for text in figure.texts] == titles
    picture = pixels(figure, tmp_path)
    panel = (8 * 40) ** 2
    assert count(picture, [250, 20, 90]) == panel
    # The range of a constant map extends half a pixel to each side: the common range is [-1, 1.5].
    colours = disparity_colours()
    assert count(picture, np.array(colours(2.0 / 2.5)[:3]) * 255) >= panel
    # Both confidences are one, a colour that no disparity has.
    assert count(picture, np.array(confidence_colours()(1.0)[:3]) * 255) >= 2 * panel


def test_failures_are_on_the_sheet():
    values = np.zeros((20, 30))
    outcomes = (Outcome("runs/with/a/name/of/many/letters/in/it" * 2, values, values, 1.0),)
    outcomes += (Outcome("b", failure="has 5x5 views, the network takes 9x9"),)
    centre = np.zeros((20, 30, 1), np.uint8)
    figure = sheet([Band("scene", centre, outcomes)] * 2, "A $note$.")
    titles = [text.get_text() for text in figure.texts]
    assert titles.count("b: failed") == 2
    corners = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert " ".join(corners).count("has 5x5 views, the network takes 9x9") == 2
    (name,) = {title for title in titles if title.endswith(": 1.0 s")}
    assert name.startswith("...")
    assert "letters/in/it: " in name
    figure.draw_without_rendering()
    for text in figure.texts:
        box = text.get_window_extent()
        assert box.x0 >= 0
        assert box.x1 <= figure.bbox.width
    alone = sheet([Band("scene", centre, outcomes[1:])], "")
    assert [text.get_text() for text in alone.texts][:2] == ["scene", "b: failed"]


def test_large_views_are_subsampled():
    values = np.zeros((100, 1500))
    views = np.zeros((100, 1500, 3), np.uint8)
    figure = sheet([Band("scene", views, (Outcome("a", values, values),))], "")
    shapes = [axes.images[0].get_array().shape[:2] for axes in figure.axes if axes.images]
    assert shapes[:2] == [(34, 500)] * 2


@pytest.mark.slow
def test_smoke_test_writes_a_sheet(run, tmp_path):
    code, out, err = run("--small", "-o", tmp_path / "s.png", "--estimators", "photometric")
    assert (code, err) == (0, "")
    assert "sample: photometric, disparity searched in [" in out
    height, width = imageio.imread(tmp_path / "s.png").shape[:2]
    assert width > 2 * 320
    assert height > 2 * 320


@pytest.mark.slow
def test_unreadable_scene_does_not_stop_the_others(run, tmp_path):
    scene = plane(grid=(3, 3), size=(32, 40), disparity=0.5)
    np.save(tmp_path / "scene.npy", scene.views)
    arguments = ("--disparity-range", 0, 1, "--estimators", "photometric")
    code, out, err = run(
        tmp_path / "absent", tmp_path / "scene.npy", "-o", tmp_path / "s.png", *arguments
    )
    assert code == 1
    assert "absent" in err
    assert err.count("\n") == 1
    assert "scene: photometric, disparity searched in [0.00, 1.00]" in out
    assert (tmp_path / "s.png").is_file()


def test_cut_out_keeps_views_and_ground_truth_aligned():
    whole = plane(size=(40, 48), slope=(0.01, 0.02))
    part = cut_out(whole, 16, (3, 5))
    np.testing.assert_array_equal(part.views[1, 2, 0, 0], whole.views[1, 2, 3, 5])
    assert part.ground_truth[15, 15] == whole.ground_truth[18, 20]
    assert cut_out(whole, 20).ground_truth[0, 0] == whole.ground_truth[10, 14]
    assert cut_out(whole, 44).image_size == (40, 44)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("-o", "s.png"), "name one or more scenes"),
        (("scene", "--small", "-o", "s.png"), "pass --small alone"),
        (("--small", "-o", "s.jpg"), "ends with .png"),
        (("--small", "-o", "s.png", "--estimators"), "name an estimator: one of proposal"),
        (("--small", "-o", "s.png", "--estimators", "best"), "best: is neither a file"),
        (("--small", "-o", "s.png", "--estimators", "occcasnet"), "needs weights"),
        (("absent", "-o", "s.png", "--estimators", "photometric"), "absent: there is no such"),
        (("--small", "-o", "file/s.png", "--estimators", "photometric"), "it is a file"),
    ],
)
def test_bad_input_is_one_line_and_code_2(run, tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    code, out, err = run(*arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert says in err
