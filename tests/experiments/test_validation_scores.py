"""Table of scores, and the models that it accepts."""

import dataclasses

import numpy as np
import pytest

from experiments import validation_scores
from experiments.validation_scores import Score, table
from occjax.errors import InputError
from occjax.evaluation import evaluate
from tests.scenes import plane


def test_table_has_each_scene_and_the_mean():
    truth = np.zeros((40, 40), np.float32)
    near, far = (Score(evaluate(truth + error, truth), 1.0) for error in (0.02, 0.1))
    lines = table({"one": {"a": near, "b": far}, "two": {"a": far, "b": far}}).splitlines()
    assert lines[2] == "| one | a | 0.04 | 0.00 | 0.00 | 100.00 | 1.00 |"
    assert lines[5] == "| two | b | 1.00 | 100.00 | 100.00 | 100.00 | 1.00 |"
    # Means of MSE x100 0.04 and 1.00, and of BadPix 0.07 0 and 100 %.
    assert lines[6] == "| mean of 2 | a | 0.52 | 50.00 | 50.00 | 100.00 | 1.00 |"


@pytest.mark.slow
def test_smoke_test_scores_the_sample(tmp_path, capsys):
    file = tmp_path / "table.md"
    results = validation_scores.run(models=("photometric",), output=file, small=True)
    (scores,) = results.values()
    metrics = scores["photometric"].metrics
    assert 0 < metrics.badpix[0.01] < 60
    written = file.read_text(encoding="utf-8")
    assert f"| photometric | {metrics.mse_x100:.2f} |" in written
    assert written in capsys.readouterr().out


def test_scenes_without_ground_truth_are_rejected():
    with pytest.raises(InputError, match="or pass --small alone"):
        validation_scores.run()
    without = dataclasses.replace(plane(), ground_truth=None)
    with pytest.raises(InputError, match="plane: has no ground truth"):
        validation_scores.score_models(without, ("photometric",))
