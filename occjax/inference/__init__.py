"""Estimators: from a light field to a disparity map."""

from occjax.inference.estimate import MODELS, Estimator, estimate
from occjax.inference.network import infer
from occjax.inference.photometric import PhotometricConfig, PhotometricResult, photometric
from occjax.inference.result import Estimate

__all__ = [
    "MODELS",
    "Estimate",
    "Estimator",
    "PhotometricConfig",
    "PhotometricResult",
    "estimate",
    "infer",
    "photometric",
]
