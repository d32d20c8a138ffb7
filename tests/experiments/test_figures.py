"""Points, deviations and panels on scenes made by hand; the small form writes every picture."""

import sys

import imageio.v3 as imageio
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from experiments import figures
from experiments.angular_patches import angular_patches, choose_points, deviation
from experiments.command_line import main
from experiments.cut_outs import cut_out
from experiments.figure_panels import BAD, GOOD, Panel, badpix_picture, panel_figure
from occjax.data.sample import sample
from occjax.errors import InputError
from occjax.io import write_pfm
from occjax.lightfield import LightField
from occjax.models import OccCasNet, preset, save_weights
from occjax.viz import save
from tests.scenes import plane

NEAR, FAR = 2.0, 0.0


@pytest.fixture
def run(monkeypatch, capsys):
    """Run the script; returns exit code, standard output and standard error."""

    def script(*arguments):
        monkeypatch.setattr(sys, "argv", ["figures", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            main(figures.run, None)
        printed = capsys.readouterr()
        return stopped.value.code, printed.out, printed.err

    return script


@pytest.fixture(scope="module")
def curtain():
    """A white half of the image two pixels a step in front of a textured wall without disparity."""
    size, edge = (40, 48), 20
    columns = np.arange(size[1])
    rows = np.arange(size[0])[:, None]
    wall = 0.25 + 0.1 * np.sin(columns * 0.9) + 0.1 * np.sin(rows * 0.7)
    views = np.empty((5, 5, *size, 1), np.float32)
    for u in range(5):
        views[:, u, ..., 0] = np.where(columns < edge - NEAR * (u - 2), 1.0, wall)
    truth = np.tile(np.where(columns < edge, NEAR, FAR), (size[0], 1)).astype(np.float32)
    return LightField(views, name="curtain", ground_truth=truth)


def test_deviations_are_those_of_what_the_views_see(curtain):
    patches = angular_patches(curtain, curtain.ground_truth)
    y, wall = 20, float(curtain.centre[20, 20, 0])
    # Right beside the curtain (column 20), it covers the two left columns of views: 10 of 25.
    share = 10 / 25
    plain = (1.0 - wall) * np.sqrt(share * (1 - share))
    assert patches.deviation[y, 20] == pytest.approx(plain, rel=1e-5)
    weight = share * wall**2  # (1 - M)^2 with M = 1 - wall
    share = weight / (weight + 15 / 25)
    weighted = (1.0 - wall) * np.sqrt(share * (1 - share))
    assert patches.weighted[y, 20] == pytest.approx(weighted, rel=1e-4)
    assert patches.deviation[y, 40] == pytest.approx(0.0, abs=1e-6)
    assert (patches.occlusion[:, :2, y, 20] > 0.4).all()
    assert patches.occlusion[:, 2:, y, 20].max() == 0.0


def test_points_are_beside_and_far_from_the_curtain(curtain):
    patches = angular_patches(curtain, curtain.ground_truth)
    clear, occluded = choose_points(curtain.ground_truth, curtain.centre[..., 0], patches)
    assert 20 <= occluded[1] < 24
    assert abs(clear[1] - 20) >= 4
    assert patches.deviation[clear] < 1e-6


def test_without_depth_steps_there_are_no_points():
    light_field = plane()
    patches = angular_patches(light_field, light_field.ground_truth)
    with pytest.raises(InputError, match="no point lies behind another"):
        choose_points(light_field.ground_truth, light_field.grey()[1, 1], patches)


def test_deviation_is_that_of_the_weighted_sample():
    generator = np.random.default_rng(0)
    grey, counts = generator.uniform(size=(2, 3)), generator.integers(1, 4, (2, 3))
    repeated = np.repeat(grey.ravel(), counts.ravel())
    assert deviation(grey, counts) == pytest.approx(np.std(repeated))
    assert deviation(grey) == pytest.approx(np.std(grey))


def test_badpix_tells_bad_good_unknown_and_missing_apart():
    disparity = np.array([[0.08, 0.06, -0.08, np.nan, 0.0, np.nan]])
    truth = np.array([[0.0, 0.0, 0.0, 0.0, np.nan, np.nan]])
    picture = badpix_picture(disparity, truth, 0.07)[0]
    grey = to_rgb("#8a8a8a")
    expected = [to_rgb(BAD), to_rgb(GOOD), to_rgb(BAD), (0.0, 0.0, 0.0), grey, grey]
    np.testing.assert_allclose(picture, expected)


def test_panels_stand_beside_each_other_pixel_for_pixel(tmp_path):
    red, blue = np.tile([1.0, 0.0, 0.0], (30, 20, 1)), np.tile([0.0, 0.0, 1.0], (10, 40, 1))
    rows = [[Panel("a", red, 2), Panel("b", blue, 3)], [Panel("c", blue)]]
    save(panel_figure(rows, "note"), tmp_path / "p.png")
    picture = imageio.imread(tmp_path / "p.png")[..., :3]
    assert (picture == [255, 0, 0]).all(-1).sum() == 30 * 20 * 4
    assert (picture == [0, 0, 255]).all(-1).sum() == 10 * 40 * (9 + 1)


def test_views_are_averaged_and_kept_apart():
    views = np.zeros((1, 2, 2, 4, 1), np.uint8)
    views[0, 1, 0, :2] = 255
    tiles = figures.tiled(views, 2)[..., 0]
    np.testing.assert_allclose(tiles, [[0.0, 0.0, 1.0, 1.0, 0.5, 0.0]])


def test_the_small_form_draws_all_that_light_has(run, tmp_path):
    code, out, err = run("--small", "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "occlusion.png is left out: light has no occlusion maps" in out
    names = {path.name for path in (tmp_path / "out").iterdir()}
    drawn = ("angular_patches", "light_field", "occlusion_maps", "stages")
    assert names == {f"{name}.png" for name in drawn}


def test_a_network_is_drawn_without_its_maps_and_methods_side_by_side(run, tmp_path):
    config = preset("tiny")
    variables = OccCasNet(config).init(jax.random.key(0), jnp.ones((3, 3, 16, 16)))
    save_weights(tmp_path / "tiny.safetensors", jax.device_get(variables), config)
    truth = cut_out(sample(), figures.SMALL).ground_truth
    write_pfm(tmp_path / "shifted.pfm", truth + np.float32(0.1))
    arguments = ("--estimator", tmp_path / "tiny.safetensors", "--points", 30, 30, 40, 40)
    code, out, err = run(
        "--small", "-o", tmp_path / "out", *arguments, "--compare", f"S={tmp_path / 'shifted.pfm'}"
    )
    assert (code, err) == (0, "")
    assert "left out" not in out
    assert {path.stem for path in (tmp_path / "out").iterdir()} == {
        *("angular_patches", "light_field", "methods", "occlusion", "occlusion_maps", "stages")
    }
    other = figures.without_maps(str(tmp_path / "tiny.safetensors"), cut_out(sample(), 32), None)
    assert other.occlusion is None


def test_the_corner_has_the_scores():
    truth = np.zeros((40, 40))
    assert figures.scores(truth + 0.05, truth) == (
        "BadPix 0.07: 0.00 %\nBadPix 0.03: 100.00 %\nMSE x100: 0.250"
    )
    assert figures.scores(truth, np.full((40, 40), np.nan)) == ""


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("-o", "out"), "name one scene"),
        (("scene", "--small", "-o", "out"), "brings its own"),
        (("--small", "-o", "file"), "file"),
        (("absent", "-o", "out"), "absent: there is no such"),
        (("--small", "-o", "out", "--estimator", "best"), "best: there is no such file"),
        (("--small", "-o", "out", "--compare", "a.pfm"), "a.pfm: is not NAME=ESTIMATE"),
        (("--small", "-o", "out", "--compare", "A=a.pfm"), "a.pfm"),
        (("--small", "-o", "out", "--compare", "A=wrong.pfm"), "wrong.pfm: is [3, 4], the views"),
        (("--small", "-o", "out", "--points", "1", "2", "64", "4"), "the point 64 4 is outside"),
    ],
)
def test_bad_input_is_one_line_and_code_2(run, tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    write_pfm(tmp_path / "wrong.pfm", np.zeros((3, 4), np.float32))
    code, out, err = run(*arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert says in err
