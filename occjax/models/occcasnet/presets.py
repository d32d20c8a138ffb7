"""The networks of the paper's tables by name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from occjax.models.occcasnet.config import (
    AggregationConfig,
    FeatureConfig,
    OccCasNetConfig,
    OcclusionSource,
    StageConfig,
)


def evenly_spaced(minimum: float, maximum: float, interval: float) -> tuple[float, ...]:
    """Return evenly spaced disparity candidates from minimum to maximum, both included.

    Args:
        minimum: Lowest candidate, pixels per view step.
        maximum: Highest candidate.
        interval: Spacing of neighbouring candidates; must divide the range.

    Returns:
        Candidates, ascending.

    Raises:
        ValueError: If the interval does not divide the range.

    Example:
        >>> evenly_spaced(-1.0, 1.0, 0.5)
        (-1.0, -0.5, 0.0, 0.5, 1.0)
    """
    steps = (maximum - minimum) / interval if interval > 0 else -1.0
    if steps < 0 or not math.isclose(steps, round(steps), abs_tol=1e-6):
        raise ValueError(f"interval is {interval}; it must divide the range [{minimum}, {maximum}]")
    return tuple(float(minimum) + index * interval for index in range(round(steps) + 1))


def _cascade(
    *stages: tuple[float, ...], occlusion: OcclusionSource = "none", **options
) -> OccCasNetConfig:
    first, *others = stages
    return OccCasNetConfig(
        (StageConfig(first), *(StageConfig(other, occlusion=occlusion) for other in others)),
        **options,
    )


def _around(interval: float) -> tuple[float, ...]:
    """Return nine residual candidates, as in every refined stage of the paper."""
    return evenly_spaced(-4 * interval, 4 * interval, interval)


_COARSE_9, _COARSE_17, _COARSE_33 = (evenly_spaced(-4.0, 4.0, step) for step in (1.0, 1 / 2, 1 / 4))


def _single_stage(interval: float) -> OccCasNetConfig:
    """Return LFattNet or SubFocal: one stage, 150 channels, 170 hidden units of attention."""
    stage = StageConfig(
        evenly_spaced(-4.0, 4.0, interval), aggregation=AggregationConfig(width=150)
    )
    return OccCasNetConfig((stage,), attention_width=170)


PRESETS: Mapping[str, OccCasNetConfig] = MappingProxyType(
    {
        # Table 3 of the paper, row by row.
        "cas_1": _cascade(_COARSE_9),
        "cas_2": _cascade(_COARSE_9, _around(1 / 8)),
        "cas_3": _cascade(_COARSE_9, _around(1 / 8), _around(1 / 16)),
        "cas_4": _cascade(_COARSE_9, _around(1 / 8), _around(1 / 16), _around(1 / 32)),
        "cas_2_share": _cascade(_COARSE_9, _around(1 / 8), shared_aggregation=True),
        "cas_2_occ": _cascade(_COARSE_9, _around(1 / 8), occlusion="coarse"),
        "cas_2_occ_gt": _cascade(_COARSE_9, _around(1 / 8), occlusion="ground_truth"),
        **{f"cas_2_interval_1_{n}": _cascade(_COARSE_9, _around(1 / n)) for n in (2, 4, 8, 16)},
        "cas_2_coarse_17": _cascade(_COARSE_17, _around(1 / 8)),
        "cas_2_coarse_33": _cascade(_COARSE_33, _around(1 / 8)),
        # The final model: Cas_2-occ with 33 and 9 candidates.
        "occcasnet": _cascade(_COARSE_33, _around(1 / 8), occlusion="coarse"),
        # The single-stage networks that the paper compares with.
        "lfattnet": _single_stage(1.0),
        "subfocal": _single_stage(1 / 10),
        # Same structure as the final model, small enough for tests.
        "tiny": OccCasNetConfig(
            (
                StageConfig(evenly_spaced(-2.0, 2.0, 1.0), aggregation=AggregationConfig(8, 1)),
                StageConfig(
                    evenly_spaced(-0.5, 0.5, 0.5),
                    aggregation=AggregationConfig(8, 1),
                    occlusion="coarse",
                ),
            ),
            views=(3, 3),
            features=FeatureConfig(blocks=(1, 1, 1, 1), pooled=(2, 4)),
            attention_width=8,
        ),
    }
)
