"""Cost of the intervals, their training in a smoke test, and the figure."""

import dataclasses
import json

import numpy as np
import pytest

from experiments import interval_study
from experiments.flops import count_flops
from experiments.interval_study import Point, figure, with_interval
from experiments.measuring import Measurement
from experiments.reduced import MEASURES
from experiments.training_rows import Training
from occjax.errors import InputError
from tests.scenes import plane


@pytest.fixture
def scene(tmp_path):
    """File with a small light field of a slanted plane."""
    light_field = plane(grid=(3, 3), size=(20, 24))
    path = tmp_path / "plane.npz"
    np.savez(path, views=light_field.views, ground_truth=light_field.ground_truth)
    return path


@pytest.mark.slow
def test_smoke_test_trains_an_interval(scene, tmp_path, capsys):
    (point,) = interval_study.run(
        tmp_path / "run", Training(validate=(scene,), small=True), intervals=(4.0,)
    )
    assert point.network.stages[0].candidates == (-4.0, 0.0, 4.0)
    assert point.scores["step"] == 2
    shown = interval_study.run(
        tmp_path / "run", Training(small=True, show=True), intervals=(4.0, 2.0)
    )
    assert [each.scores for each in shown] == [point.scores, {}]
    assert capsys.readouterr().out.splitlines()[-1].startswith("| 2 | 5 |  |  |")


def test_cost_is_proportional_to_the_number_of_candidates():
    flops = [count_flops(with_interval(interval)) for interval in (1.0, 1 / 2, 1 / 4, 1 / 10)]
    per_candidate = [
        (after - before) / count
        for before, after, count in zip(flops, flops[1:], (8, 16, 48), strict=False)
    ]
    # 150 channels of 3x3x3 taps: 324 go in, then six layers, one score; 256x256 pixels.
    convolutions = 2 * 256**2 * 27 * (324 * 150 + 6 * 150**2 + 150)
    assert per_candidate == pytest.approx([per_candidate[0]] * 3)
    assert per_candidate[0] == pytest.approx(convolutions, rel=1e-3)


def test_figure_has_a_panel_for_each_known_measure():
    network = with_interval(1.0)
    known = {"badpix_0.07": 2.0, "mse_x100": 1.0}
    point = Point(network, count_flops(network), {})
    titles = [axes.get_title() for axes in figure([point]).axes]
    assert titles == ["FLOPs"]
    both = [point, dataclasses.replace(point, scores=known, measured=Measurement(0.5, 10**9))]
    panels = figure(both).axes
    assert [axes.get_title() for axes in panels] == list(interval_study.PANELS)
    assert [len(axes.lines[0].get_xdata()) for axes in panels] == [1, 1, 2, 1]
    assert [axes.lines[0].get_ydata()[-1] for axes in panels] == (
        [2.0, 1.0, pytest.approx(6.21e12, abs=0.005e12), 0.5]
    )


def test_reduced_study_plots_the_finished_rows(tmp_path, capsys):
    for name, score in {"cas_1": 4.0, "interval_1_2": 3.0}.items():
        lines = [{"kind": "row", "row": name, "multiply_adds": 1, "config": {}}]
        scores = dict.fromkeys(MEASURES, score)
        lines += [{"kind": "scores", "scene": "procedural", "region": "all", **scores}]
        lines += [{"kind": "time", "seconds_per_megapixel": 2.5}]
        text = "".join(json.dumps(line) + "\n" for line in lines)
        (tmp_path / f"{name}-0.jsonl").write_text(text)
    point, finer = interval_study.run(tmp_path, Training(show=True), reduced=True)
    assert (finer.candidates, finer.interval, finer.scores["mse_x100"]) == (17, 0.5, 3.0)
    assert (point.candidates, point.interval, point.measured.seconds) == (9, 1.0, 2.5)
    assert point.scores == {"badpix_0.07": 4.0, "mse_x100": 4.0}
    assert "| `cas_1` | 1 |" in capsys.readouterr().out
    assert (tmp_path / "interval_study_cost.png").stat().st_size > 0


def test_interval_that_does_not_divide_the_range_is_rejected(tmp_path):
    with pytest.raises(InputError, match=r"interval is 0\.3; it must divide"):
        interval_study.run(tmp_path, Training(show=True), intervals=(0.3,))
