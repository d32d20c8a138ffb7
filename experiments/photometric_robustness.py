"""Errors of the training-free estimator with fewer views, noise and dark exposures.

    python -m experiments.photometric_robustness
    python -m experiments.photometric_robustness --small          (seconds)

Cost: three minutes on two cores. Expected: the error grows with fewer views (a single row of views
has no parallax along horizontal edges), exposure changes only the rounding, and noise has little
effect until it reaches the contrast of the texture. The scene is the bundled sample, on which
nothing was tuned. The result is committed as ``photometric_robustness.md``.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from tqdm import tqdm

from experiments.command_line import Small, announce_smoke_test, main
from experiments.cut_outs import SMALL_SIZE_PX, small_sample
from experiments.markdown import markdown_table
from occjax.estimators import make_estimator, run_estimator
from occjax.evaluation import Metrics, evaluate
from occjax.lightfield import LightField

SIZE_PX = 256
"""Height and width of the views."""

GRIDS = ((9, 9), (7, 7), (5, 5), (3, 3), (1, 9), (9, 1))

NOISE_LEVELS = (2.0, 4.0, 8.0)
"""Standard deviations of the noise, in levels of 255."""

EXPOSURE_DIVISORS = (4, 16)
"""Divisors of the brightness; 12-bit values stored in 16 bits are divided by 16."""


def conditions(size: int) -> dict[str, LightField]:
    """Return the central ``size`` x ``size`` pixels of the sample under every condition."""
    part = small_sample(size)
    clean = dataclasses.replace(part, views=part.floating())

    def with_views(views: np.ndarray) -> LightField:
        return dataclasses.replace(clean, views=np.clip(views, 0.0, 1.0).astype(np.float32))

    noise = np.random.default_rng(0).normal(size=clean.views.shape)
    found = {f"{v}x{u} views": clean.central(v, u) for v, u in GRIDS}
    for level in NOISE_LEVELS:
        found[f"noise {level:g}/255"] = with_views(clean.views + noise * level / 255)
    for divisor in EXPOSURE_DIVISORS:
        dark = np.round(clean.views / divisor * 65535) / 65535
        found[f"exposure 1/{divisor}"] = with_views(dark)
    return found


def table(results: dict[str, Metrics]) -> str:
    """Return the metrics as a Markdown table."""
    head = ["condition", "MSE x100", "BadPix 0.07", "0.03", "0.01"]
    rows = [
        [name, f"{m.mse_x100:.2f}", *(f"{percent:.1f}" for percent in m.badpix.values())]
        for name, m in results.items()
    ]
    return markdown_table(head, rows)


def run(small: Small = False) -> dict[str, Metrics]:
    """Estimate every condition, print the table, and return the metrics by condition."""
    if small:
        announce_smoke_test()
    estimator = make_estimator("photometric")
    results = {}
    scenes = conditions(SMALL_SIZE_PX if small else SIZE_PX)
    for name, light_field in tqdm(scenes.items(), unit="scene", disable=None):
        assert light_field.ground_truth is not None
        disparity = run_estimator(estimator, light_field).disparity
        results[name] = evaluate(disparity, light_field.ground_truth)
    print(table(results))
    return results


if __name__ == "__main__":
    main(run, __doc__)
