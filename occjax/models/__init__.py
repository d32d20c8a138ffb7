"""Networks as Flax modules, built from frozen configurations, and their weights."""

from occjax.models.cascade import OccCasNet, variable_shapes
from occjax.models.config import (
    Choice,
    DerivativeFeatures,
    FeatureConfig,
    NetworkConfig,
    Residual,
    SemiGlobalConfig,
    StageConfig,
)
from occjax.models.fetch import fetch_published_weights
from occjax.models.presets import PRESETS, preset, sampled
from occjax.models.stages import StageOutput
from occjax.models.weights import load_weights, save_weights

__all__ = [
    "PRESETS",
    "Choice",
    "DerivativeFeatures",
    "FeatureConfig",
    "NetworkConfig",
    "OccCasNet",
    "Residual",
    "SemiGlobalConfig",
    "StageConfig",
    "StageOutput",
    "fetch_published_weights",
    "load_weights",
    "preset",
    "sampled",
    "save_weights",
    "variable_shapes",
]
