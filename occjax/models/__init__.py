"""Networks as Flax modules, built from frozen configurations."""

from occjax.models.cascade import OccCasNet, StageOutput
from occjax.models.config import (
    PRESETS,
    FeatureConfig,
    NetworkConfig,
    StageConfig,
    preset,
    sampled,
)

__all__ = [
    "PRESETS",
    "FeatureConfig",
    "NetworkConfig",
    "OccCasNet",
    "StageConfig",
    "StageOutput",
    "preset",
    "sampled",
]
