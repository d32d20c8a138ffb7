"""occjax: disparity from light fields by occlusion-aware cascade cost volumes, in JAX.

Read a light field with :func:`load` and estimate the disparity of its centre view with
:func:`estimate`. The differentiable cost-volume functions are in :mod:`occjax.ops`, the networks in
:mod:`occjax.models`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from occjax.errors import InputError

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

_HOME = {
    "Calibration": "occjax.lightfield",
    "Estimate": "occjax.estimators",
    "Estimator": "occjax.estimators",
    "LightField": "occjax.lightfield",
    "check": "occjax.layout",
    "estimate": "occjax.estimators",
    "load": "occjax.io",
    "make_estimator": "occjax.estimators",
}
"""Module of each name that is imported when it is first used, so that ``import occjax`` is fast."""


def __getattr__(name: str) -> Any:
    """Import a public name or subpackage when it is first used."""
    if name in _HOME:
        return getattr(importlib.import_module(_HOME[name]), name)
    if name in __all__:
        return importlib.import_module(f"occjax.{name}")
    raise AttributeError(f"module 'occjax' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
