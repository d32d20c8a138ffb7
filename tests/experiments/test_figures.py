"""Points, deviations and panels of constructed scenes, and a smoke test of all figures."""

import imageio.v3 as imageio
import jax
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from experiments import figures
from experiments.angular_patches import angular_patches, choose_points, deviation
from experiments.cut_outs import cut_out, small_sample
from experiments.figure_panels import FRAME, Panel, frame_lines, panel_figure
from experiments.light_field_picture import busiest_square, light_field_figure, tiled
from experiments.map_panels import (
    BAD_COLOUR,
    BEST,
    GOOD_COLOUR,
    SECOND,
    badpix_picture,
    maps_figure,
    score_lines,
)
from experiments.networks import small_form
from experiments.real_scenes import named_estimator
from occjax.data.bundled_sample import sample
from occjax.errors import InputError
from occjax.estimators import run_estimator
from occjax.io import write_pfm
from occjax.lightfield import LightField
from occjax.models import preset, save_weights, variable_shapes
from occjax.viz import save
from tests.scenes import plane

NEAR, FAR = 2.0, 0.0


@pytest.fixture(scope="module")
def curtain():
    """White half of the image with disparity 2 before a textured wall with disparity 0."""
    size, edge = (40, 48), 20
    columns = np.arange(size[1])
    rows = np.arange(size[0])[:, None]
    wall = 0.25 + 0.1 * np.sin(columns * 0.9) + 0.1 * np.sin(rows * 0.7)
    views = np.empty((5, 5, *size, 1), np.float32)
    for u in range(5):
        views[:, u, ..., 0] = np.where(columns < edge - NEAR * (u - 2), 1.0, wall)
    truth = np.tile(np.where(columns < edge, NEAR, FAR), (size[0], 1)).astype(np.float32)
    return LightField(views, name="curtain", ground_truth=truth)


def test_deviations_match_the_visible_views(curtain, tolerance):
    patches = angular_patches(curtain, curtain.ground_truth)
    y, wall = 20, float(curtain.centre[20, 20, 0])
    # At column 20 the curtain occludes the point in the two left columns of views: 10 of 25.
    share = 10 / 25
    plain = (1.0 - wall) * np.sqrt(share * (1 - share))
    np.testing.assert_allclose(patches.deviation[y, 20], plain, **tolerance("relative"))
    weight = share * wall**2  # (1 - M)^2 with M = 1 - wall
    share = weight / (weight + 15 / 25)
    weighted = (1.0 - wall) * np.sqrt(share * (1 - share))
    np.testing.assert_allclose(patches.weighted[y, 20], weighted, **tolerance("float32"))
    np.testing.assert_allclose(patches.deviation[y, 40], 0.0, **tolerance("absolute"))
    assert (patches.occlusion[:, :2, y, 20] > 0.4).all()
    assert patches.occlusion[:, 2:, y, 20].max() == 0.0


def test_points_are_near_and_far_from_the_curtain(curtain):
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


def test_weighted_deviation_matches_repeated_samples():
    generator = np.random.default_rng(0)
    grey, counts = generator.uniform(size=(2, 3)), generator.integers(1, 4, (2, 3))
    repeated = np.repeat(grey.ravel(), counts.ravel())
    assert deviation(grey, counts) == pytest.approx(np.std(repeated))
    assert deviation(grey) == pytest.approx(np.std(grey))


def test_badpix_map_has_a_colour_for_each_kind_of_pixel():
    disparity = np.array([[0.08, 0.06, -0.08, np.nan, 0.0, np.nan]])
    truth = np.array([[0.0, 0.0, 0.0, 0.0, np.nan, np.nan]])
    picture = badpix_picture(disparity, truth, 0.07)[0]
    grey = to_rgb("#8a8a8a")
    expected = [
        to_rgb(BAD_COLOUR),
        to_rgb(GOOD_COLOUR),
        to_rgb(BAD_COLOUR),
        (0.0, 0.0, 0.0),
        grey,
        grey,
    ]
    np.testing.assert_allclose(picture, expected)


def test_panels_are_next_to_each_other_pixel_by_pixel(tmp_path):
    red, blue = np.tile([1.0, 0.0, 0.0], (30, 20, 1)), np.tile([0.0, 0.0, 1.0], (10, 40, 1))
    rows = [[Panel("a", red, 2), Panel("b", blue, 3)], [Panel("c", blue)]]
    save(panel_figure(rows, "note", left_panel=Panel("d", red, 5)), tmp_path / "p.png")
    picture = imageio.imread(tmp_path / "p.png")[..., :3]
    is_red, is_blue = (picture == [255, 0, 0]).all(-1), (picture == [0, 0, 255]).all(-1)
    assert is_red.sum() == 30 * 20 * (4 + 25)
    assert is_red.any(0).argmax() < is_blue.any(0).argmax()  # d is to the left of all
    assert is_blue.sum() == 10 * 40 * (9 + 1)


def test_views_are_averaged_with_gaps_between_them():
    views = np.zeros((1, 2, 2, 4, 1), np.uint8)
    views[0, 1, 0, :2] = 255
    tiles = tiled(views, 2)[..., 0]
    np.testing.assert_allclose(tiles, [[0.0, 0.0, 1.0, 1.0, 0.5, 0.0]])


@pytest.mark.slow
def test_smoke_test_draws_all_figures_of_the_proposal_network(script, tmp_path):
    code, out, err = script(figures.run, "--small", "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "occlusion.png is omitted: proposal has no occlusion maps" in out
    names = {path.name for path in (tmp_path / "out").iterdir()}
    drawn = ("angular_patches", "light_field", "methods", "occlusion_maps", "stages")
    assert names == {f"{name}.png" for name in drawn}


@pytest.mark.slow
def test_network_of_the_paper_is_compared_without_its_occlusion_maps(script, tmp_path):
    config = small_form(preset("occcasnet"))
    variables = jax.tree.map(lambda leaf: np.full(leaf.shape, 0.02), variable_shapes(config))
    save_weights(tmp_path / "tiny.safetensors", variables, config)
    truth = small_sample().ground_truth
    write_pfm(tmp_path / "shifted.pfm", truth + np.float32(0.1))
    arguments = ("--estimator", tmp_path / "tiny.safetensors", "--points", 30, 30, 40, 40)
    code, out, err = script(
        figures.run,
        "--small",
        "-o",
        tmp_path / "out",
        *arguments,
        "--compare",
        f"S={tmp_path / 'shifted.pfm'}",
    )
    assert (code, err) == (0, "")
    assert "omitted" not in out
    assert {path.stem for path in (tmp_path / "out").iterdir()} == {
        *("angular_patches", "light_field", "methods", "occlusion", "occlusion_maps", "stages")
    }
    without = figures.without_occlusion(named_estimator(str(tmp_path / "tiny.safetensors")))
    assert run_estimator(without, small_sample(32)).occlusion is None


@pytest.mark.slow
def test_every_stage_of_a_cascade_is_drawn(tmp_path):
    """Stages are identified by their largest residuals, 1/2, 1/4 and 1/8."""
    config = small_form(preset("cas_4"))
    variables = jax.tree.map(lambda leaf: np.full(leaf.shape, 0.02), variable_shapes(config))
    save_weights(tmp_path / "four.safetensors", variables, config)
    estimator = named_estimator(str(tmp_path / "four.safetensors"))
    estimate = run_estimator(estimator, small_sample(32))
    stages = figures.named_stages(estimate, "four")
    assert list(stages) == ["first stage", "stage 2", "stage 3", "last stage"]
    maps = list(stages.values())
    np.testing.assert_array_equal(maps[0], estimate.coarse)
    np.testing.assert_array_equal(maps[-1], estimate.disparity)
    for before, after, reach in zip(maps, maps[1:], (1 / 2, 1 / 4, 1 / 8), strict=False):
        assert 0 < np.abs(after - before).max() <= reach + 1e-5


def test_score_lines_have_badpix_and_mse():
    truth = np.zeros((40, 40))
    lines = score_lines({"a": truth + 0.05}, truth)["a"]
    assert [words for words, _ in lines] == [
        *("BadPix 0.07: 0.00 %", "BadPix 0.03: 100.00 %", "MSE x100: 0.250")
    ]
    assert score_lines({"a": truth}, np.full((40, 40), np.nan)) == {"a": []}


def test_best_scores_are_red_and_second_best_blue():
    truth = np.zeros((40, 40))
    maps = {"worst": truth + 0.2, "best": truth + 0.01, "second": truth + 0.1}
    colours = {
        name: [colour for _, colour in lines]
        for name, lines in score_lines(maps, truth, rank=True).items()
    }
    assert colours["best"] == [BEST] * 3
    # The others have equal percentages.
    assert colours["second"] == [SECOND] * 3
    assert colours["worst"][:2] == [SECOND] * 2
    assert colours["worst"][2] not in (BEST, SECOND)
    two = score_lines({"a": maps["best"], "b": maps["second"]}, truth, rank=True)
    assert SECOND not in {colour for lines in two.values() for _, colour in lines}
    plain = score_lines(maps, truth)
    assert not {BEST, SECOND} & {colour for lines in plain.values() for _, colour in lines}


def test_frame_surrounds_true_pixels():
    framed = np.zeros((3, 4), bool)
    framed[1, 1:3] = True
    lines = {tuple(map(tuple, line)) for line in frame_lines(framed).tolist()}
    assert lines == {
        *(((0.5, 0.5), (1.5, 0.5)), ((1.5, 0.5), (2.5, 0.5))),
        *(((0.5, 1.5), (1.5, 1.5)), ((1.5, 1.5), (2.5, 1.5))),
        *(((0.5, 0.5), (0.5, 1.5)), ((2.5, 0.5), (2.5, 1.5))),
    }


def test_frame_is_drawn_around_the_macro_pixels(curtain, tmp_path):
    save(light_field_figure(curtain), tmp_path / "p.png")
    picture = imageio.imread(tmp_path / "p.png")[..., :3] / 255.0
    assert (np.abs(picture - to_rgb(FRAME)).max(-1) < 0.01).sum() > 100


def test_square_with_most_texture_is_found():
    generator = np.random.default_rng(0)
    grey = np.full((30, 40), 0.5)
    grey[11:18, 21:28] = generator.uniform(size=(7, 7))
    rows, columns = busiest_square(grey, 9)
    assert rows.stop - rows.start == columns.stop - columns.start == 9
    assert set(range(11, 18)) <= set(range(rows.start, rows.stop))
    assert set(range(21, 28)) <= set(range(columns.start, columns.stop))


def test_colour_range_without_ground_truth_includes_all_maps(tmp_path):
    light_field = LightField(np.zeros((1, 1, 8, 8, 1), np.uint8))
    maps = {"low": np.zeros((8, 8)), "high": np.ones((8, 8))}
    save(maps_figure(light_field, maps, binary=True), tmp_path / "p.png")
    picture = imageio.imread(tmp_path / "p.png")[..., :3]
    # First and last colour of viridis.
    for colour in ([68, 1, 84], [253, 231, 36]):
        assert (picture == colour).all(-1).sum() > 500 * 500


@pytest.mark.slow
def test_scene_without_ground_truth_is_drawn(script, tmp_path):
    part = cut_out(sample().central(3, 3), 48, (128, 64))
    np.save(tmp_path / "scene.npy", part.views)
    write_pfm(tmp_path / "a.pfm", np.zeros(part.image_size, np.float32))
    code, out, err = script(
        figures.run,
        *(tmp_path / "scene.npy", "-o", tmp_path / "out", "--estimator", "photometric"),
        *("--compare", f"a={tmp_path / 'a.pfm'}"),
    )
    assert (code, err) == (0, "")
    assert "there is no ground truth" in out
    assert {path.stem for path in (tmp_path / "out").iterdir()} == {
        *("angular_patches", "light_field", "methods", "occlusion_maps", "stages")
    }


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("-o", "out"), "name one scene"),
        (("scene", "--small", "-o", "out"), "pass --small alone"),
        (("--small", "-o", "file"), "file"),
        (("absent", "-o", "out"), "absent: there is no such"),
        (("--small", "-o", "out", "--estimator", "best"), "best: is neither a file"),
        (("--small", "-o", "out", "--disparity-range", "2", "1"), "minimum < maximum"),
        (("--small", "-o", "out", "--compare", "a.pfm"), "a.pfm: is not NAME=ESTIMATE"),
        (("--small", "-o", "out", "--compare", "A=a.pfm"), "a.pfm"),
        (("--small", "-o", "out", "--compare", "A=wrong.pfm"), "wrong.pfm: is [3, 4], the views"),
        (("--small", "-o", "out", "--points", "1", "2", "64", "4"), "the point 64 4 is outside"),
    ],
)
def test_bad_input_is_one_line_and_code_2(script, tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    write_pfm(tmp_path / "wrong.pfm", np.zeros((3, 4), np.float32))
    code, out, err = script(figures.run, *arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert says in err
