"""The table of scores is made of what the metrics say."""

import dataclasses
from importlib.resources import files

import numpy as np
import pytest

from experiments import validation_scores
from experiments.cut_outs import cut_out
from experiments.validation_scores import Score, table
from occjax.data.sample import sample
from occjax.errors import InputError
from occjax.evaluation import evaluate
from tests.scenes import plane


def test_the_table_has_each_scene_and_the_mean():
    truth = np.zeros((40, 40), np.float32)
    near, far = (Score(evaluate(truth + error, truth), 1.0) for error in (0.02, 0.1))
    lines = table({"one": {"a": near, "b": far}, "two": {"a": far, "b": far}}).splitlines()
    assert lines[2] == "| one | a | 0.04 | 0.00 | 0.00 | 100.00 | 1.00 |"
    assert lines[5] == "| two | b | 1.00 | 100.00 | 100.00 | 100.00 | 1.00 |"
    # MSE x100 of 0.04 and 1.00, BadPix 0.07 of none and all
    assert lines[6] == "| mean of 2 | a | 0.52 | 50.00 | 50.00 | 100.00 | 1.00 |"


def test_the_small_form_scores_the_sample(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(validation_scores, "SMALL", 48)
    file = tmp_path / "table.md"
    results = validation_scores.run(models=("photometric",), output=file, small=True)
    (scores,) = results.values()
    metrics = scores["photometric"].metrics
    assert 0 < metrics.badpix[0.01] < 60
    written = file.read_text(encoding="utf-8")
    assert f"| photometric | {metrics.mse_x100:.2f} |" in written
    assert written in capsys.readouterr().out


def test_weights_in_a_file_are_a_model(tmp_path):
    file = tmp_path / "mine.safetensors"
    file.write_bytes((files("occjax.models") / "weight_files/light.safetensors").read_bytes())
    scores = validation_scores.scores_of(cut_out(sample(), 64), ("light", str(file)))
    assert scores[str(file)].metrics == scores["light"].metrics


def test_what_cannot_be_scored_is_said():
    with pytest.raises(InputError, match="give scenes, or --small"):
        validation_scores.run()
    without = dataclasses.replace(plane(), ground_truth=None)
    with pytest.raises(InputError, match="plane: has no ground truth"):
        validation_scores.scores_of(without, ("photometric",))
