"""Smoke tests of trainings, and networks with the published numbers of their rows."""

import dataclasses
import json

import pytest

from experiments import ablation
from experiments.ablation import GROUPS, ROWS
from experiments.flops import count_flops, count_parameters
from experiments.networks import small_form
from experiments.training_rows import Training, base_recipe, finished_scores, with_row
from occjax.errors import InputError
from occjax.training import learning_rate


def cells_of(printed, row):
    """Return the cells of a row's first line in the printed table."""
    line = next(line for line in printed.splitlines() if f"`{row}`" in line)
    return [cell.strip() for cell in line.split("|")[1:-1]]


@pytest.mark.slow
def test_smoke_test_trains_a_row_once_and_shows_it(tmp_path, capsys):
    results = ablation.run(tmp_path, ("cas_1",), Training(small=True))
    ours = results["cas_1"]
    assert ours["step"] == 2
    # Candidates, intervals, parameters and FLOPs as in table 3 of the paper.
    expected = ["stages", "`cas_1`", "9", "1", "2.41 M", "3.11 T"]
    expected += [f"{ours['badpix_0.07']:.3f}", "2.804", f"{ours['mse_x100']:.3f}", "1.164"]
    printed = capsys.readouterr()
    assert cells_of(printed.out, "cas_1") == expected
    assert printed.out.startswith("| about |")  # only the table
    assert "cas_1: step 2: mse_x100" in printed.err

    log = (tmp_path / "cas_1" / "log.jsonl").read_text()
    assert ablation.run(tmp_path, training=Training(show=True)) == results
    printed = capsys.readouterr().out
    assert cells_of(printed, "cas_1") == expected
    assert cells_of(printed, "cas_2_occ_gt")[6:] == ["", "2.257", "", "0.792"]
    assert ablation.run(tmp_path, ("cas_1",), Training(small=True)) == results
    assert (tmp_path / "cas_1" / "log.jsonl").read_text() == log


def test_row_that_the_paper_does_not_have_has_no_published_scores(tmp_path, capsys):
    name = "cas_2_statistics"
    (tmp_path / name).mkdir()
    (tmp_path / name / "config.json").write_text(json.dumps({"occjax": "0", "steps": 2}))
    entry = {"kind": "validation", "step": 2, "badpix_0.07": 2.5, "mse_x100": 1.25}
    (tmp_path / name / "log.jsonl").write_text(json.dumps(entry) + "\n")
    ablation.run(tmp_path, (name,), Training(show=True))
    assert cells_of(capsys.readouterr().out, name)[6:] == ["2.500", "", "1.250", ""]


def test_interrupted_row_is_not_finished(tmp_path):
    assert finished_scores(tmp_path) is None
    (tmp_path / "config.json").write_text(json.dumps({"occjax": "0", "steps": 20}))
    assert finished_scores(tmp_path) is None
    entries = [{"kind": "validation", "step": step, "mse_x100": 1.0 / step} for step in (10, 20)]
    log = tmp_path / "log.jsonl"
    log.write_text(json.dumps(entries[0]) + "\n")
    assert finished_scores(tmp_path) is None
    log.write_text("\n".join(map(json.dumps, entries)) + "\n")
    assert finished_scores(tmp_path)["mse_x100"] == 0.05


@pytest.mark.parametrize("name", [name for name, row in ROWS.items() if row.published])
def test_networks_have_the_published_parameters_and_flops(name):
    row = ROWS[name]
    assert f"{count_parameters(row.network) / 1e6:.2f}" == row.published.parameters
    assert f"{count_flops(row.network) / 1e12:#.3g}" == row.published.tera_flops


def test_every_row_is_in_a_group_with_others():
    assert {name for names in GROUPS.values() for name in names} == set(ROWS)
    assert all(len(names) > 1 for names in GROUPS.values())


@pytest.mark.parametrize("name", list(ROWS))
def test_small_networks_have_the_same_stages(name):
    large, small = ROWS[name].network, small_form(ROWS[name].network)
    assert small.warp == large.warp
    assert small.shared_aggregation == large.shared_aggregation
    for one, other in zip(small.stages, large.stages, strict=True):
        assert one.aggregation.width == 4
        assert dataclasses.replace(one, aggregation=other.aggregation) == other


def test_rows_differ_only_in_network_and_seed(tmp_path):
    base = base_recipe("published", data=[tmp_path])
    again = with_row(base, ROWS["cas_2_again"])
    assert (again.train.seed, again.data.seed) == (1, 1)
    assert again.train.network.feature_statistics == "per_view"  # as published
    assert again.train.network.stages == ROWS["cas_2"].network.stages
    unchanged = dataclasses.replace(again.train, network=base.train.network, seed=0)
    assert unchanged == base.train
    assert dataclasses.replace(again.data, seed=0) == base.data


def test_schedule_of_a_shortened_training_shrinks_in_proportion(tmp_path):
    short = base_recipe("published", data=[tmp_path], steps=1200).train
    rate = learning_rate(short.optimiser, short.steps)
    # 120 epochs, now of 10 steps: rate 1e-3 * 0.5^floor((epoch + 1) / 30).
    found = [float(rate(10 * epoch + 5)) for epoch in (0, 28, 29, 58, 59, 119)]
    assert found == pytest.approx([1e-3, 1e-3, 5e-4, 5e-4, 2.5e-4, 1e-3 / 16])


@pytest.mark.parametrize(
    ("rows", "options", "message"),
    [
        ((), {"data": ()}, "16 additional scenes"),
        ((), {}, "pass --validate"),
        (("cas_5",), {}, "no row named 'cas_5'; there are cas_1"),
        ((), {"recipe": "full", "steps": 0}, "steps is 0"),
    ],
)
def test_missing_input_is_reported_before_training(tmp_path, rows, options, message):
    training = Training(**{"data": (tmp_path,), **options})
    with pytest.raises(InputError, match=message):
        ablation.run(tmp_path / "run", rows, training)
    assert not (tmp_path / "run").exists()
