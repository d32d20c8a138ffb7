"""occjax: disparity from light fields by occlusion-aware cascade cost volumes, in JAX.

Read a light field with :func:`load`, estimate the disparity of its centre view with
:func:`estimate`; or build on the differentiable cost-volume functions in :mod:`occjax.ops` and the
networks in :mod:`occjax.models`.
"""

from occjax import evaluation, inference, io, models, ops
from occjax.errors import InputError
from occjax.inference import Estimate, Estimator, estimate, infer, photometric
from occjax.io import check, load
from occjax.lightfield import Calibration, LightField

__version__ = "0.1.0"

__all__ = [
    "Calibration",
    "Estimate",
    "Estimator",
    "InputError",
    "LightField",
    "check",
    "estimate",
    "evaluation",
    "infer",
    "inference",
    "io",
    "load",
    "models",
    "ops",
    "photometric",
]
