"""Does the confidence find the wrong pixels? Errors without the least certain ones.

    python -m experiments.sparsification                               (the bundled sample)
    python -m experiments.sparsification SCENE... -o TABLE.md --figure CURVES.png
    python -m experiments.sparsification --small                       (seconds)

Cost: five seconds a scene of 256x256 pixels on two cores. Expected: without the 20 % of the pixels
that are least certain, ``proposal`` has less than half of its wrong pixels. The area is the mean of
BadPix 0.07 over all fractions that can be left out; "ideal" is the area if the pixels were ordered
by their error. The border of the metrics is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from experiments.command_line import Models, Small, TrueScenes, announce_smoke_test, main
from experiments.cut_outs import small_sample
from experiments.markdown import markdown_table, print_text
from experiments.real_scenes import named_estimator
from occjax import load
from occjax.cli.options import option
from occjax.data.bundled_sample import sample
from occjax.errors import InputError
from occjax.estimators import run_estimator
from occjax.evaluation.metrics import BAD_PIXEL_THRESHOLD, compared_pixels, default_border
from occjax.lightfield import LightField
from occjax.viz.canvas import save

MODELS = ("proposal", "photometric")

LEFT_OUT = (0.05, 0.1, 0.2, 0.3, 0.5)
"""Fractions of the pixels that are left out, in the table."""


class Curve(NamedTuple):
    """BadPix by the number of certain pixels that are kept.

    Attributes:
        badpix: ``[n]`` BadPix in % of the most certain pixel, of the two most certain, ...
        ideal: The same if the pixels were ordered by their error.
    """

    badpix: np.ndarray
    ideal: np.ndarray

    def without(self, fraction: float) -> float:
        """Return BadPix in % without a fraction of the pixels."""
        return float(self.badpix[round((1 - fraction) * len(self.badpix)) - 1])


def curve(errors: np.ndarray, confidence: np.ndarray) -> Curve:
    """Return the sparsification curve of a map.

    Args:
        errors: ``[n]`` absolute errors, pixels per view step.
        confidence: ``[n]`` confidence of the same pixels; equal ones keep their order.

    Example:
        >>> curve(np.array([0.0, 1.0, 0.0, 0.0]), np.array([0.9, 0.1, 0.2, 0.8])).badpix.tolist()
        [0.0, 0.0, 0.0, 25.0]
    """

    def badpix(order: np.ndarray) -> np.ndarray:
        wrong = errors[order] > BAD_PIXEL_THRESHOLD
        return 100.0 * np.cumsum(wrong) / np.arange(1, len(wrong) + 1)

    return Curve(
        badpix(np.argsort(-confidence, kind="stable")), badpix(np.argsort(errors, kind="stable"))
    )


def measure(scene: LightField, model: str) -> Curve:
    """Estimate a scene and return the curve of its confidence.

    Args:
        scene: Light field with ground truth.
        model: Name of a model, or a file of weights.

    Raises:
        InputError: If the scene has no ground truth.
    """
    if scene.ground_truth is None:
        raise InputError(f"{scene.name}: has no ground truth to compare with")
    estimate = run_estimator(named_estimator(model), scene)
    border = default_border(scene.image_size)
    compared = compared_pixels(estimate.disparity, scene.ground_truth, border=border)
    errors = np.abs(estimate.disparity - scene.ground_truth)
    return curve(errors[compared], estimate.confidence[compared])


def table(curves: Mapping[tuple[str, str], Curve]) -> str:
    """Return BadPix without the least certain pixels as Markdown, by scene and model."""
    parts = [f"without {fraction:.0%}" for fraction in LEFT_OUT]
    rows = []
    for (scene, model), each in curves.items():
        values = [each.badpix[-1], *map(each.without, LEFT_OUT)]
        values += [each.badpix.mean(), each.ideal.mean()]
        rows.append([scene, model, *(f"{value:.2f}" for value in values)])
    return markdown_table(["scene", "model", "all", *parts, "area", "ideal"], rows)


def draw(curves: Mapping[tuple[str, str], Curve], models: Sequence[str]) -> Figure:
    """Draw the curves of each model, relative to BadPix of all pixels, one line per scene."""
    figure = Figure(figsize=(4.5 * len(models), 3.6), layout="constrained")
    for axes, model in zip(figure.subplots(1, len(models), squeeze=False)[0], models, strict=True):
        for (scene, other), each in curves.items():
            if other == model:
                left_out = 100 * (1 - np.arange(1, len(each.badpix) + 1) / len(each.badpix))
                axes.plot(left_out, each.badpix / max(each.badpix[-1], 1e-9), label=scene)
        axes.axhline(0.5, color="grey", linewidth=0.7, linestyle=":")
        axes.set(title=model, xlabel="least certain pixels left out, %", ylim=(0, 1), xlim=(0, 95))
        axes.set_ylabel(f"BadPix {BAD_PIXEL_THRESHOLD:g} relative to all pixels")
        axes.legend(frameon=False, fontsize=7)
    return figure


def run(
    scenes: TrueScenes = (),
    models: Models = MODELS,
    output: Annotated[Path | None, option("File for the table.", "FILE", "-o")] = None,
    figure: Annotated[Path | None, option("File for the curves.", "FILE")] = None,
    small: Small = False,
) -> dict[tuple[str, str], Curve]:
    """Measure every model on every scene, and print the table."""
    if small:
        announce_smoke_test()
    light_fields = [small_sample() if small else sample(), *map(load, scenes)]
    curves = {
        (scene.name, model): measure(scene, model) for scene in light_fields for model in models
    }
    print_text(table(curves), output)
    if figure is not None:
        save(draw(curves, models), figure)
    return curves


if __name__ == "__main__":
    main(run, __doc__)
