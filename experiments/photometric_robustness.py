"""How the training-free estimator copes with fewer views, noise and dark exposures.

    python -m experiments.photometric_robustness
    python -m experiments.photometric_robustness --small          (seconds, for the test)

Cost: about three minutes on two cores. Expected: the error grows with fewer views (one row of views
sees no motion along its own texture), exposure changes nothing but rounding, and noise costs little
until it reaches the contrast of the texture. The bundled sample is the scene, since nothing was
tuned on it. The result is committed beside this file as ``photometric_robustness.md``.
"""

from __future__ import annotations

import dataclasses
from typing import Annotated

import numpy as np
import tyro
from tqdm import tqdm

from experiments.command_line import main
from experiments.cut_outs import cut_out
from experiments.markdown import markdown_table
from occjax.data.sample import sample
from occjax.evaluation import Metrics, evaluate
from occjax.inference import Estimator
from occjax.lightfield import LightField

SMALL = 64
"""Side of the cut-out of the small form, in pixels."""
GRIDS = ((9, 9), (7, 7), (5, 5), (3, 3), (1, 9), (9, 1))
NOISE = (2.0, 4.0, 8.0)
"""Standard deviations, in levels of 255."""
EXPOSURES = (4, 16)
"""Divisors of the brightness; 12-bit values stored in 16 bits are divided by 16."""


def scenes(size: int) -> dict[str, LightField]:
    """The sample's middle ``size`` x ``size`` pixels under every condition, by its name."""
    part = cut_out(sample(), size)
    clean = dataclasses.replace(part, views=part.floating())

    def with_views(views: np.ndarray) -> LightField:
        return dataclasses.replace(clean, views=np.clip(views, 0.0, 1.0).astype(np.float32))

    noise = np.random.default_rng(0).normal(size=clean.views.shape)
    conditions = {f"{v}x{u} views": clean.central(v, u) for v, u in GRIDS}
    conditions |= {f"noise {s:g}/255": with_views(clean.views + noise * s / 255) for s in NOISE}
    conditions |= {
        f"exposure 1/{divisor}": with_views(np.round(clean.views / divisor * 65535) / 65535)
        for divisor in EXPOSURES
    }
    return conditions


def table(results: dict[str, Metrics]) -> str:
    """Metrics as a Markdown table."""
    head = ["condition", "MSE x100", "BadPix 0.07", "0.03", "0.01"]
    rows = [
        [name, f"{m.mse_x100:.2f}", *(f"{percent:.1f}" for percent in m.badpix.values())]
        for name, m in results.items()
    ]
    return markdown_table(head, rows)


def run(
    size: Annotated[int, tyro.conf.arg(help="Side of the cut-out, in pixels.")] = 256,
    small: Annotated[bool, tyro.conf.arg(help=f"{SMALL} pixels.")] = False,
) -> dict[str, Metrics]:
    """Estimate every condition, print the table, and return the metrics by condition."""
    estimator = Estimator("photometric")
    results = {}
    conditions = scenes(SMALL if small else size)
    for name, light_field in tqdm(conditions.items(), unit="scene", disable=None):
        assert light_field.ground_truth is not None
        disparity = estimator(light_field).disparity
        results[name] = evaluate(disparity, light_field.ground_truth)
    print(table(results))
    return results


if __name__ == "__main__":
    main(run, __doc__)
