"""The study's scores are those of the weights it is given; cost is linear in the candidates."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import interval_study
from experiments.interval_study import Point, figure, with_interval
from experiments.measuring import Measured
from experiments.networks import small_form
from experiments.paper_training import Training
from experiments.score_tables import shown
from occjax.errors import InputError
from occjax.models import OccCasNet, preset, save_weights
from occjax.models.work import count_flops
from tests.reference.variables import random_variables
from tests.scenes import plane


@pytest.fixture
def scene(tmp_path):
    """A file with a small light field of a slanted plane, and the light field."""
    light_field = plane(grid=(3, 3), size=(20, 24))
    path = tmp_path / "plane.npz"
    np.savez(path, views=light_field.views, ground_truth=light_field.ground_truth)
    return path, light_field


def weights_file(path, network):
    variables = random_variables(network)
    save_weights(path, variables, network)
    return variables


def test_given_weights_are_scored_and_drawn(scene, tmp_path, capsys):
    path, light_field = scene
    networks = [small_form(with_interval(interval)) for interval in (1.0, 2.0)]
    files = [tmp_path / f"{number}.safetensors" for number in range(2)]
    variables = list(map(weights_file, files, networks))
    points = interval_study.run(
        tmp_path, Training(validate=(path,), small=True), weights=tuple(files)
    )
    # The coarse one comes first, whatever the order of the files.
    for point, number in zip(points, (1, 0), strict=True):
        views = jnp.asarray(light_field.grey())
        disparity = jax.jit(OccCasNet(networks[number]).apply)(variables[number], views)[
            -1
        ].disparity
        error = np.abs(disparity - light_field.ground_truth)[4:-4, 4:-4]
        assert point.scores["badpix_0.07"] == pytest.approx(100 * (error > 0.07).mean())
        assert point.scores["mse_x100"] == pytest.approx(100 * (error**2).mean(), rel=1e-4)
    printed = capsys.readouterr().out.splitlines()
    assert printed[2].startswith(f"| 2 | 5 | {shown(points[0].scores['badpix_0.07'])} |")
    assert printed[3].startswith("| 1 | 9 |")
    assert (tmp_path / "intervals.png").stat().st_size > 1000


def test_the_small_form_trains_an_interval(scene, tmp_path, capsys):
    (point,) = interval_study.run(
        tmp_path / "run", Training(validate=(scene[0],), small=True), intervals=(4.0,)
    )
    assert point.network.stages[0].candidates == (-4.0, 0.0, 4.0)
    assert point.scores["step"] == 2
    shown = interval_study.run(
        tmp_path / "run", Training(small=True, show=True), intervals=(4.0, 2.0)
    )
    assert [each.scores for each in shown] == [point.scores, {}]
    assert capsys.readouterr().out.splitlines()[-1].startswith("| 2 | 5 |  |  |")


def test_each_candidate_costs_the_same():
    flops = [count_flops(with_interval(interval)) for interval in (1.0, 1 / 2, 1 / 4, 1 / 10)]
    per_candidate = [
        (after - before) / count
        for before, after, count in zip(flops, flops[1:], (8, 16, 48), strict=False)
    ]
    # 150 channels of 3x3x3 taps: 324 go in, then six layers, one score; 256x256 pixels.
    convolutions = 2 * 256**2 * 27 * (324 * 150 + 6 * 150**2 + 150)
    assert per_candidate == pytest.approx([per_candidate[0]] * 3)
    assert per_candidate[0] == pytest.approx(convolutions, rel=1e-3)


def test_the_figure_has_a_panel_for_what_is_known():
    network = with_interval(1.0)
    known = {"badpix_0.07": 2.0, "mse_x100": 1.0}
    point = Point(network, count_flops(network), {})
    titles = [axes.get_title() for axes in figure([point]).axes]
    assert titles == ["FLOPs"]
    both = [point, dataclasses.replace(point, scores=known, measured=Measured(0.5, 10**9))]
    panels = figure(both).axes
    assert [axes.get_title() for axes in panels] == list(interval_study.PANELS)
    assert [len(axes.lines[0].get_xdata()) for axes in panels] == [1, 1, 2, 1]
    assert [axes.lines[0].get_ydata()[-1] for axes in panels] == (
        [2.0, 1.0, pytest.approx(6.21e12, abs=0.005e12), 0.5]
    )


def test_bad_input_says_what_to_do(scene, tmp_path):
    with pytest.raises(InputError, match=r"interval of 0\.3 does not divide"):
        interval_study.run(tmp_path, Training(show=True), intervals=(0.3,))
    file = tmp_path / "cascade.safetensors"
    weights_file(file, small_form(preset("cas_2")))
    with pytest.raises(InputError, match="pass --validate"):
        interval_study.run(tmp_path, weights=(file,))
    with pytest.raises(InputError, match=r"cascade\.safetensors: holds no network of a single"):
        interval_study.run(tmp_path, Training(validate=(scene[0],)), weights=(file,))
