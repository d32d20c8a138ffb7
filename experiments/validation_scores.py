"""How models do on scenes with ground truth: the table of the rendered validation set.

    occjax render runs/validation --seeds 1000 1008        (an hour on two cores)
    python -m experiments.validation_scores runs/validation/s* --output TABLE.md
    python -m experiments.validation_scores --small        (seconds, for the test)

Cost: ten seconds a scene of 256x256 pixels for the two models of the default. No weights of the
package were trained on the scenes of seeds 1000 to 1007. Expected: the light network is ahead in
the mean of every measure, and in every scene by BadPix 0.07. All are far from the percents of the
HCI benchmark, whose scenes have no such noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
import tyro
from tqdm import tqdm

from experiments.command_line import main
from experiments.cut_outs import cut_out
from experiments.markdown import markdown_table
from experiments.real_scenes import named_estimator
from occjax import load
from occjax.cli.options import option
from occjax.data.sample import sample
from occjax.errors import InputError
from occjax.evaluation import Metrics, evaluate
from occjax.io.atomic import atomic_path
from occjax.lightfield import LightField

SMALL = 96
"""Side of the cut-out of the bundled sample that the small form estimates, in pixels."""


class Score(NamedTuple):
    """One estimate.

    Attributes:
        metrics: Its errors.
        seconds: It took, without compilation.
    """

    metrics: Metrics
    seconds: float

    @property
    def numbers(self) -> list[float]:
        """MSE x100, BadPix in % by threshold, seconds."""
        return [self.metrics.mse_x100, *self.metrics.badpix.values(), self.seconds]


def scores_of(scene: LightField, models: Sequence[str]) -> dict[str, Score]:
    """Every model's score on one scene.

    Args:
        scene: With its ground truth.
        models: Names of models, or files of weights.

    Raises:
        InputError: If the scene has no ground truth, or there is no such model.
    """
    if scene.ground_truth is None:
        raise InputError(f"{scene.name}: has no ground truth to score against")
    scores = {}
    for model in models:
        estimate = named_estimator(model)(scene)
        metrics = evaluate(estimate.disparity, scene.ground_truth)
        scores[model] = Score(metrics, estimate.seconds["run"])
    return scores


def table(results: Mapping[str, Mapping[str, Score]]) -> str:
    """Scores by scene and model, and each model's mean over the scenes, as Markdown."""
    models = list(next(iter(results.values())))
    thresholds = next(iter(results.values()))[models[0]].metrics.badpix
    head = ["scene", "model", "MSE x100", *(f"BadPix {t:g}" for t in thresholds), "seconds"]
    rows = [
        (scene, model, score.numbers)
        for scene, scores in results.items()
        for model, score in scores.items()
    ]
    for model in models:
        numbers = [scores[model].numbers for scores in results.values()]
        rows.append((f"mean of {len(numbers)}", model, list(np.mean(numbers, axis=0))))
    cells = [[where, model, *(f"{x:.2f}" for x in numbers)] for where, model, numbers in rows]
    return markdown_table(head, cells)


def run(
    scenes: tyro.conf.Positional[
        Annotated[tuple[Path, ...], tyro.conf.arg(help="Scenes with ground truth.")]
    ] = (),
    models: Annotated[tuple[str, ...], tyro.conf.arg(help="Models, or files of weights.")] = (
        "photometric",
        "light",
    ),
    output: Annotated[Path | None, option("File for the table.", "FILE", "-o")] = None,
    small: Annotated[bool, tyro.conf.arg(help="Part of the bundled sample alone.")] = False,
) -> dict[str, dict[str, Score]]:
    """Estimate every scene by every model, print the table, and return the scores."""
    if bool(scenes) == small:
        raise InputError("give scenes, or --small alone for the bundled sample")
    results = {}
    for path in tqdm([None] if small else scenes, unit="scene", disable=None):
        scene = cut_out(sample(), SMALL) if path is None else load(path)
        results[scene.name] = scores_of(scene, models)
    print(table(results))
    if output is not None:
        with atomic_path(output) as temporary:
            temporary.write_text(table(results) + "\n", encoding="utf-8")
    return results


if __name__ == "__main__":
    main(run, __doc__)
