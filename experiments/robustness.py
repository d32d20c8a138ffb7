"""Errors of the two bundled models with fewer views, noise, and other exposures.

    python -m experiments.robustness --output TABLE.md                 (the bundled sample)
    python -m experiments.robustness SCENE... --output TABLE.md
    python -m experiments.robustness --small                           (a minute)

Cost: three minutes on two cores for the bundled sample. Expected: BadPix grows with fewer views and
with noise on weak texture. The parallax of a single row of views is horizontal, and a horizontal
edge does not show it. Darkening all views equally only adds rounding; a different exposure of each
view is measured and corrected. On weak texture, fewer pixels can be measured by ``occjax check``
under noise. The table of the sample is committed as ``robustness.md``; nothing was tuned on its
conditions.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from tqdm import tqdm

from experiments.command_line import Small, announce_smoke_test, main
from experiments.cut_outs import small_sample
from experiments.markdown import markdown_table, print_text
from experiments.validation_scores import Score, score_models
from occjax import load
from occjax.cli.options import option
from occjax.data.bundled_sample import sample
from occjax.estimators.driver import with_report
from occjax.layout import check
from occjax.lightfield import LightField

MODELS = ("proposal", "photometric")

GRIDS = ((9, 9), (7, 7), (5, 5), (3, 3), (2, 2), (1, 9), (9, 1))

NOISE_LEVELS = (2.0, 4.0, 8.0)
"""Standard deviations of the noise, in grey levels of 8 bits."""

EXPOSURE_DIVISOR = 16
"""Divisor of the brightness of all views, as of 12-bit values that are stored in 16 bits."""

EXPOSURE_SPREAD = 0.3
"""Largest deviation of the exposure of a view from the mean exposure."""


def conditions(scene: LightField) -> Iterator[tuple[str, LightField]]:
    """Yield the name of each condition and the light field under it.

    Args:
        scene: Light field as it is.
    """
    clean = dataclasses.replace(scene, views=scene.floating(), view_order_report=None)

    def with_views(views: np.ndarray) -> LightField:
        return dataclasses.replace(clean, views=np.clip(views, 0.0, 1.0).astype(np.float32))

    rng = np.random.default_rng(0)
    for v, u in GRIDS:
        if v <= scene.grid[0] and u <= scene.grid[1]:
            yield f"{v}x{u} views", clean.central(v, u)
    noise = rng.normal(size=clean.views.shape)
    for level in NOISE_LEVELS:
        yield f"noise {level:g}/255", with_views(clean.views + noise * level / 255)
    dark = np.round(clean.views / EXPOSURE_DIVISOR * 65535) / 65535
    yield f"exposure 1/{EXPOSURE_DIVISOR}", with_views(dark)
    gains = rng.uniform(1 - EXPOSURE_SPREAD, 1 + EXPOSURE_SPREAD, (*scene.grid, 1, 1, 1))
    uneven = clean.views * gains / (1 + EXPOSURE_SPREAD)
    yield f"exposure of each view +-{EXPOSURE_SPREAD:.0%}", with_views(uneven)


@dataclasses.dataclass(frozen=True)
class Result:
    """Scores of the models under one condition.

    Attributes:
        measured_fraction: Fraction of the pixels whose disparity ``occjax check`` can measure.
        scores: Scores by model.
    """

    measured_fraction: float
    scores: dict[str, Score]


def table(results: dict[str, dict[str, Result]]) -> str:
    """Return the scores by scene and condition as a Markdown table."""
    measures = ("MSE x100", "BadPix 0.07", "0.03", "0.01")
    head = ["scene", "condition", "measurable"]
    head += [f"{model}: {measures[0]}, {', '.join(measures[1:])}" for model in MODELS]
    rows = []
    for scene, found in results.items():
        for name, result in found.items():
            row = [scene, name, f"{result.measured_fraction:.1%}"]
            for model in MODELS:
                metrics = result.scores[model].metrics
                badpix = ", ".join(f"{percent:.1f}" for percent in metrics.badpix.values())
                row.append(f"{metrics.mse_x100:.2f}, {badpix}")
            rows.append(row)
    return markdown_table(head, rows)


def run(
    scenes: tyro.conf.Positional[
        Annotated[tuple[Path, ...], tyro.conf.arg(help="Scenes instead of the bundled sample.")]
    ] = (),
    output: Annotated[Path | None, option("File for the table.", "FILE", "-o")] = None,
    small: Small = False,
) -> dict[str, dict[str, Result]]:
    """Estimate every condition of every scene, print the table, and return the results."""
    if small:
        announce_smoke_test()
    light_fields = [load(path) for path in scenes] or [small_sample() if small else sample()]
    results: dict[str, dict[str, Result]] = {}
    for scene in light_fields:
        found = results.setdefault(scene.name, {})
        for name, light_field in tqdm(conditions(scene), unit="condition", disable=None):
            light_field = with_report(light_field)  # once for both models
            fraction = check(light_field).measured_fraction
            found[name] = Result(fraction, score_models(light_field, MODELS))
    print_text(table(results), output)
    return results


if __name__ == "__main__":
    main(run, __doc__)
