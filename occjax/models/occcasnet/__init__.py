"""OccCasNet: the paper's network and its variants.

Reading order: :mod:`config`, :mod:`features`, :mod:`aggregation`, :mod:`network`, :mod:`stages`;
then :mod:`prediction`, the same network in strips for images of any size.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from occjax.lazy import lazy_names

if TYPE_CHECKING:
    from occjax.models.occcasnet.config import (
        AggregationConfig,
        FeatureConfig,
        OccCasNetConfig,
        StageConfig,
    )
    from occjax.models.occcasnet.network import OccCasNet
    from occjax.models.occcasnet.prediction import predict
    from occjax.models.occcasnet.presets import PRESETS, sampled
    from occjax.models.occcasnet.published_weights import fetch_published_weights
    from occjax.models.occcasnet.stages import StageOutput

__all__ = [
    "PRESETS",
    "AggregationConfig",
    "FeatureConfig",
    "OccCasNet",
    "OccCasNetConfig",
    "StageConfig",
    "StageOutput",
    "fetch_published_weights",
    "predict",
    "sampled",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "occjax.models.occcasnet.config": (
            "AggregationConfig",
            "FeatureConfig",
            "OccCasNetConfig",
            "StageConfig",
        ),
        "occjax.models.occcasnet.network": ("OccCasNet",),
        "occjax.models.occcasnet.prediction": ("predict",),
        "occjax.models.occcasnet.presets": ("PRESETS", "sampled"),
        "occjax.models.occcasnet.published_weights": ("fetch_published_weights",),
        "occjax.models.occcasnet.stages": ("StageOutput",),
    },
)
