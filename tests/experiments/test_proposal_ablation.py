"""Smoke test of the ablation; each row changes one setting."""

import dataclasses

import pytest

from experiments import proposal_ablation
from experiments.proposal_ablation import ROWS, Scale, base_recipe
from occjax.errors import InputError


@pytest.mark.slow
def test_smoke_test_trains_a_row_and_prints_it(tmp_path, capsys):
    rows = ("one ray per pixel",)
    results = proposal_ablation.run(tmp_path, rows=rows, small=True)
    assert tuple(results) == rows
    printed = capsys.readouterr().out.splitlines()
    table = [line for line in printed if line.startswith("|")]
    assert table[0].startswith("| training | procedural")
    bad = results["one ray per pixel"]["badpix_0.07"]
    assert table[2].startswith("| one ray per pixel |")
    assert f" / {bad:.1f} / " in table[2]
    # A finished row is read, not trained again.
    assert proposal_ablation.run(tmp_path, rows=rows, small=True) == results


def test_unknown_row_is_rejected_before_training(tmp_path):
    with pytest.raises(InputError, match="no row named 'nothing'; there are unchanged"):
        proposal_ablation.run(tmp_path / "run", rows=("nothing",), small=True)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("name", [name for name in ROWS if name != "unchanged"])
def test_every_row_changes_one_setting(name):
    base = base_recipe(Scale())
    row = ROWS[name](base)
    assert row != base
    changed = {
        f"{part}.{field.name}"
        for part in ("train", "data")
        for field in dataclasses.fields(getattr(base, part))
        if getattr(getattr(row, part), field.name) != getattr(getattr(base, part), field.name)
    }
    assert changed <= {"train.seed", "data.seed"} or len(changed) == 1
