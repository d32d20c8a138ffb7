"""Scores of models on scenes with ground truth, by scene and in the mean.

    python -m experiments.blender runs/validation --seeds 1000 1008     (an hour on two cores)
    python -m experiments.validation_scores runs/validation/s* --output TABLE.md
    python -m experiments.validation_scores --small                     (seconds)

Cost: ten seconds a scene of 256x256 pixels for the two default models. The weights of the package
were not trained on the scenes of seeds 1000 to 1007. Expected: the proposal network has smaller
errors than the photometric estimator in the mean of every measure, and in BadPix 0.07 on nearly
every scene. All errors are far above those on the HCI benchmark, whose scenes have less noise. The
result is committed as ``validation_scores.md``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from tqdm import tqdm

from experiments.command_line import Models, Small, TrueScenes, announce_smoke_test, main
from experiments.cut_outs import small_sample
from experiments.markdown import markdown_table, print_text
from experiments.real_scenes import named_estimator
from occjax import load
from occjax.cli.options import option
from occjax.errors import InputError
from occjax.estimators import run_estimator
from occjax.evaluation import Metrics, evaluate
from occjax.lightfield import LightField


class Score(NamedTuple):
    """Score of one estimate.

    Attributes:
        metrics: Errors.
        seconds: Run time without compilation.
    """

    metrics: Metrics
    seconds: float

    @property
    def numbers(self) -> list[float]:
        """MSE x100, BadPix in % by threshold, and seconds."""
        return [self.metrics.mse_x100, *self.metrics.badpix.values(), self.seconds]


def score_models(scene: LightField, models: Sequence[str]) -> dict[str, Score]:
    """Score every model on one scene.

    Args:
        scene: Light field with ground truth.
        models: Names of models, or files of weights.

    Returns:
        Scores by model.

    Raises:
        InputError: If the scene has no ground truth, or a model does not exist.
    """
    if scene.ground_truth is None:
        raise InputError(f"{scene.name}: has no ground truth to score against")
    scores = {}
    for model in models:
        estimate = run_estimator(named_estimator(model), scene)
        metrics = evaluate(estimate.disparity, scene.ground_truth)
        scores[model] = Score(metrics, estimate.seconds["run"])
    return scores


def table(results: Mapping[str, Mapping[str, Score]]) -> str:
    """Return the scores by scene and model, and each model's mean, as Markdown."""
    first = next(iter(results.values()))
    models = list(first)
    head = ["scene", "model", "MSE x100"]
    head += [f"BadPix {threshold:g}" for threshold in first[models[0]].metrics.badpix]
    rows = [
        (scene, model, score.numbers)
        for scene, scores in results.items()
        for model, score in scores.items()
    ]
    for model in models:
        numbers = [scores[model].numbers for scores in results.values()]
        rows.append((f"mean of {len(numbers)}", model, list(np.mean(numbers, axis=0))))
    cells = [[scene, model, *(f"{x:.2f}" for x in numbers)] for scene, model, numbers in rows]
    return markdown_table([*head, "seconds"], cells)


def run(
    scenes: TrueScenes = (),
    models: Models = ("photometric", "proposal"),
    output: Annotated[Path | None, option("File for the table.", "FILE", "-o")] = None,
    small: Small = False,
) -> dict[str, dict[str, Score]]:
    """Run every model on every scene, print the table, and return the scores."""
    if bool(scenes) == small:
        raise InputError("name scenes with ground truth, or pass --small alone")
    if small:
        announce_smoke_test()
    results = {}
    for path in tqdm([None] if small else scenes, unit="scene", disable=None):
        scene = small_sample() if path is None else load(path)
        results[scene.name] = score_models(scene, models)
    print_text(table(results), output)
    return results


if __name__ == "__main__":
    main(run, __doc__)
