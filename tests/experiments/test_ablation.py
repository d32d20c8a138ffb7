"""The small form trains and resumes; rows are the networks whose numbers stand beside them."""

import dataclasses
import json

import pytest

from experiments import ablation
from experiments.ablation import GROUPS, ROWS
from experiments.networks import small_form
from experiments.paper_training import Training, base_recipe, small_recipe, with_row
from experiments.training_rows import scores_if_done
from occjax.errors import InputError
from occjax.models.work import count_flops, count_parameters
from occjax.training import learning_rate


def cells_of(printed, row):
    """Cells of a row's first line in the printed table."""
    line = next(line for line in printed.splitlines() if f"`{row}`" in line)
    return [cell.strip() for cell in line.split("|")[1:-1]]


def test_the_small_form_trains_a_row_once_and_shows_it(tmp_path, capsys):
    results = ablation.run(tmp_path, ("cas_2_occ_gt",), Training(small=True))
    ours = results["cas_2_occ_gt"]
    assert ours["step"] == 2
    # Candidates, intervals, parameters and FLOPs as in table 3 of the paper.
    expected = ["sharing, occlusion", "`cas_2_occ_gt`", "9, 9", "1, 1/8", "4.79 M", "5.87 T"]
    expected += [f"{ours['badpix_0.07']:.3f}", "2.257", f"{ours['mse_x100']:.3f}", "0.792"]
    printed = capsys.readouterr()
    assert cells_of(printed.out, "cas_2_occ_gt") == expected
    assert printed.out.startswith("| about |")  # the table alone
    assert "cas_2_occ_gt: step 2: mse_x100" in printed.err

    log = (tmp_path / "cas_2_occ_gt" / "log.jsonl").read_text()
    assert ablation.run(tmp_path, training=Training(show=True)) == results
    printed = capsys.readouterr().out
    assert cells_of(printed, "cas_2_occ_gt") == expected
    assert cells_of(printed, "cas_1")[6:] == ["", "2.804", "", "1.164"]
    assert ablation.run(tmp_path, ("cas_2_occ_gt",), Training(small=True)) == results
    assert (tmp_path / "cas_2_occ_gt" / "log.jsonl").read_text() == log


@pytest.mark.parametrize("name", ["cas_2_occ_transposed", "cas_2_statistics"])
def test_rows_that_the_paper_does_not_have_train(tmp_path, name, capsys):
    ours = ablation.run(tmp_path, (name,), Training(small=True))[name]
    assert ours["step"] == 2
    scores = [f"{ours['badpix_0.07']:.3f}", "", f"{ours['mse_x100']:.3f}", ""]
    assert cells_of(capsys.readouterr().out, name)[6:] == scores


def test_a_row_that_was_interrupted_is_not_done(tmp_path):
    assert scores_if_done(tmp_path) is None
    (tmp_path / "config.json").write_text(json.dumps({"occjax": "0", "steps": 20}))
    assert scores_if_done(tmp_path) is None
    entries = [{"kind": "validation", "step": step, "mse_x100": 1.0 / step} for step in (10, 20)]
    log = tmp_path / "log.jsonl"
    log.write_text(json.dumps(entries[0]) + "\n")
    assert scores_if_done(tmp_path) is None
    log.write_text("\n".join(map(json.dumps, entries)) + "\n")
    assert scores_if_done(tmp_path)["mse_x100"] == 0.05


@pytest.mark.parametrize("name", [name for name, row in ROWS.items() if row.published])
def test_networks_have_the_parameters_and_flops_printed_in_their_row(name):
    row = ROWS[name]
    assert f"{count_parameters(row.network) / 1e6:.2f}" == row.published.parameters
    assert f"{count_flops(row.network) / 1e12:#.3g}" == row.published.tera_flops


def test_rows_that_the_paper_does_not_have_differ_from_theirs_in_one_thing():
    def on(name, **changes):
        network = ROWS[name].network
        stages = tuple(dataclasses.replace(stage, **changes) for stage in network.stages)
        return dataclasses.replace(network, stages=stages)

    transposed = ROWS["cas_2_occ_transposed"].network
    assert dataclasses.replace(transposed, warp="correct") == ROWS["cas_2_occ"].network
    assert transposed != ROWS["cas_2_occ"].network
    assert on("cas_2", attention=False) == ROWS["cas_2_no_attention"].network
    statistics = ROWS["cas_2_statistics"].network
    assert on("cas_2_no_attention", volume="statistics") == statistics
    assert on("cas_2_statistics", volume="concatenate") != statistics


def test_every_row_is_compared_with_something():
    assert {name for names in GROUPS.values() for name in names} == set(ROWS)
    assert all(len(names) > 1 for names in GROUPS.values())


@pytest.mark.parametrize("name", list(ROWS))
def test_small_networks_have_the_stages_of_the_large_ones(name):
    large, small = ROWS[name].network, small_form(ROWS[name].network)
    assert small.warp == large.warp
    assert small.shared_aggregation == large.shared_aggregation
    for one, other in zip(small.stages, large.stages, strict=True):
        assert one.aggregation.width == 4
        assert dataclasses.replace(one, aggregation=other.aggregation) == other


def test_rows_differ_in_network_and_seed_alone(tmp_path):
    base = base_recipe("published", data=[tmp_path])
    again = with_row(base, ROWS["cas_2_again"])
    assert (again.train.seed, again.data.seed) == (1, 1)
    assert again.train.network.feature_statistics == "per_view"  # as published
    assert again.train.network.stages == ROWS["cas_2"].network.stages
    unchanged = dataclasses.replace(again.train, network=base.train.network, seed=0)
    assert unchanged == base.train
    assert dataclasses.replace(again.data, seed=0) == base.data


def test_a_shortened_training_halves_its_rate_at_the_same_parts_of_its_way(tmp_path):
    short = base_recipe("published", data=[tmp_path], steps=1200).train
    rate = learning_rate(short.optimiser, short.steps)
    # 120 epochs, now of 10 steps: rate 1e-3 * 0.5^floor((epoch + 1) / 30).
    found = [float(rate(10 * epoch + 5)) for epoch in (0, 28, 29, 58, 59, 119)]
    assert found == pytest.approx([1e-3, 1e-3, 5e-4, 5e-4, 2.5e-4, 1e-3 / 16])


def test_the_small_recipe_is_over_after_two_steps():
    assert small_recipe().train.steps == 2


@pytest.mark.parametrize(
    ("rows", "options", "message"),
    [
        ((), {"data": ()}, "16 additional scenes"),
        ((), {}, "pass --validate"),
        (("cas_5",), {}, "no row named 'cas_5'; there are cas_1"),
        ((), {"recipe": "full", "steps": 0}, "steps is 0"),
    ],
)
def test_what_is_missing_is_said_before_anything_is_trained(tmp_path, rows, options, message):
    training = Training(**{"data": (tmp_path,), **options})
    with pytest.raises(InputError, match=message):
        ablation.run(tmp_path / "run", rows, training)
    assert not (tmp_path / "run").exists()
