"""Estimators: from a light field to a disparity map.

``cli -> driver.run_estimator -> an Estimator (prepare, run, finish) -> its model``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from occjax.lazy import lazy_names

if TYPE_CHECKING:
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

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "occjax.estimators.driver": (
            "estimate",
            "estimate_occlusion",
            "export_estimator",
            "run_estimator",
        ),
        "occjax.estimators.factory": ("make_estimator",),
        "occjax.estimators.protocol": ("Estimate", "Estimator", "ModelInputs"),
    },
)
