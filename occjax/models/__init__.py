"""Networks as Flax modules, built from frozen configurations, and their weights."""

from __future__ import annotations

from typing import TYPE_CHECKING

from occjax.lazy import lazy_names

if TYPE_CHECKING:
    from occjax.models.occcasnet import (
        AggregationConfig,
        FeatureConfig,
        OccCasNet,
        OccCasNetConfig,
        StageConfig,
        StageOutput,
        fetch_published_weights,
        predict,
        sampled,
    )
    from occjax.models.proposal import ProposalConfig, ProposalNet, ProposalOutput
    from occjax.models.registry import ALIASES, PRESETS, ModelConfig, preset, variable_shapes
    from occjax.models.weights import load_weights, save_weights

__all__ = [
    "ALIASES",
    "PRESETS",
    "AggregationConfig",
    "FeatureConfig",
    "ModelConfig",
    "OccCasNet",
    "OccCasNetConfig",
    "ProposalConfig",
    "ProposalNet",
    "ProposalOutput",
    "StageConfig",
    "StageOutput",
    "fetch_published_weights",
    "load_weights",
    "predict",
    "preset",
    "sampled",
    "save_weights",
    "variable_shapes",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "occjax.models.occcasnet": (
            "AggregationConfig",
            "FeatureConfig",
            "OccCasNet",
            "OccCasNetConfig",
            "StageConfig",
            "StageOutput",
            "fetch_published_weights",
            "predict",
            "sampled",
        ),
        "occjax.models.proposal": ("ProposalConfig", "ProposalNet", "ProposalOutput"),
        "occjax.models.registry": (
            "ALIASES",
            "PRESETS",
            "ModelConfig",
            "preset",
            "variable_shapes",
        ),
        "occjax.models.weights": ("load_weights", "save_weights"),
    },
)
