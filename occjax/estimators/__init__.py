"""Estimators: from a light field to a disparity map.

``cli -> driver.run_estimator -> an Estimator (prepare, run, finish) -> its model``.
"""

from occjax.estimators.driver import (
    estimate,
    estimate_occlusion,
    export_estimator,
    run_estimator,
)
from occjax.estimators.factory import make_estimator
from occjax.estimators.protocol import Estimate, Estimator, ModelInputs

__all__ = [
    "Estimate",
    "Estimator",
    "ModelInputs",
    "estimate",
    "estimate_occlusion",
    "export_estimator",
    "make_estimator",
    "run_estimator",
]
