"""The small form of the ablation runs, and each row changes what it says."""

import dataclasses

import pytest

from experiments import light_ablation
from experiments.light_ablation import ROWS, Scale, base_recipe
from occjax.errors import InputError


def test_the_small_form_trains_its_rows_and_prints_them(tmp_path, capsys):
    rows = ("as it is", "one ray per pixel")
    results = light_ablation.run(tmp_path, rows=rows, small=True)
    assert tuple(results) == rows
    printed = capsys.readouterr().out.splitlines()
    table = [line for line in printed if line.startswith("|")]
    assert table[0].startswith("| training | procedural")
    bad = results["one ray per pixel"]["badpix_0.07"]
    assert table[3].startswith("| one ray per pixel |")
    assert f" / {bad:.1f} / " in table[3]
    # Done rows are read, not trained again.
    assert light_ablation.run(tmp_path, rows=rows, small=True) == results


def test_a_row_that_there_is_not_is_told_before_anything_is_made(tmp_path):
    with pytest.raises(InputError, match="no row named 'nothing'; there are as it is"):
        light_ablation.run(tmp_path / "run", rows=("nothing",), small=True)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("name", [name for name in ROWS if name != "as it is"])
def test_every_row_is_one_change_to_the_training(name):
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
