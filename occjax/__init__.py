"""occjax: disparity from light fields by occlusion-aware cascade cost volumes, in JAX.

Read a light field with :func:`load` and estimate the disparity of its centre view with
:func:`estimate`. The differentiable cost-volume functions are in :mod:`occjax.ops`, the networks in
:mod:`occjax.models`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from occjax.errors import InputError
from occjax.lazy import lazy_names

if TYPE_CHECKING:
    from occjax import data, estimators, evaluation, io, layout, models, ops, results, training, viz
    from occjax.estimators import Estimate, Estimator, estimate, make_estimator
    from occjax.io import load
    from occjax.layout import check
    from occjax.lightfield import Calibration, LightField

__version__ = "0.1.0"

__all__ = [
    "Calibration",
    "Estimate",
    "Estimator",
    "InputError",
    "LightField",
    "check",
    "data",
    "estimate",
    "estimators",
    "evaluation",
    "io",
    "layout",
    "load",
    "make_estimator",
    "models",
    "ops",
    "results",
    "training",
    "viz",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "occjax": (
            *("data", "estimators", "evaluation", "io", "layout", "models", "ops", "results"),
            *("training", "viz"),
        ),
        "occjax.lightfield": ("Calibration", "LightField"),
        "occjax.estimators": ("Estimate", "Estimator", "estimate", "make_estimator"),
        "occjax.io": ("load",),
        "occjax.layout": ("check",),
    },
)
