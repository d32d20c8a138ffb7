"""Networks as Flax modules, built from frozen configurations, and their weights."""

from occjax.models.cascade import OccCasNet, StageOutput, variable_shapes
from occjax.models.config import (
    PRESETS,
    FeatureConfig,
    NetworkConfig,
    StageConfig,
    preset,
    sampled,
)
from occjax.models.fetch import fetch_published_weights
from occjax.models.weights import load_weights, save_weights

__all__ = [
    "PRESETS",
    "FeatureConfig",
    "NetworkConfig",
    "OccCasNet",
    "StageConfig",
    "StageOutput",
    "fetch_published_weights",
    "load_weights",
    "preset",
    "sampled",
    "save_weights",
    "variable_shapes",
]
