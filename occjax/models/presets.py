"""Networks by name: those of the paper's tables, and the light ones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from occjax.errors import InputError
from occjax.models.config import (
    Choice,
    DerivativeFeatures,
    FeatureConfig,
    NetworkConfig,
    OcclusionSource,
    Residual,
    SemiGlobalConfig,
    StageConfig,
)


def sampled(minimum: float, maximum: float, interval: float) -> tuple[float, ...]:
    """Disparity candidates from minimum to maximum, both included.

    Args:
        minimum: Lowest candidate, pixels per view step.
        maximum: Highest candidate.
        interval: Distance of neighbouring candidates; must divide the range.

    Returns:
        The candidates, ascending.

    Raises:
        ValueError: If the interval does not divide the range.

    Example:
        >>> sampled(-1.0, 1.0, 0.5)
        (-1.0, -0.5, 0.0, 0.5, 1.0)
    """
    steps = (maximum - minimum) / interval if interval > 0 else -1.0
    if steps < 0 or not math.isclose(steps, round(steps), abs_tol=1e-6):
        raise ValueError(f"an interval of {interval} does not divide [{minimum}, {maximum}]")
    return tuple(float(minimum) + index * interval for index in range(round(steps) + 1))


def _cascade(
    *stages: tuple[float, ...], occlusion: OcclusionSource = "none", **options
) -> NetworkConfig:
    first, *others = stages
    return NetworkConfig(
        (StageConfig(first), *(StageConfig(other, occlusion=occlusion) for other in others)),
        **options,
    )


def _around(interval: float) -> tuple[float, ...]:
    """Nine residual candidates, as in every refined stage of the paper."""
    return sampled(-4 * interval, 4 * interval, interval)


_AROUND = (
    *((-4, 0), (4, 0), (0, -4), (0, 4)),
    *((-10, -10), (-10, 10), (10, -10), (10, 10)),
)
"""Pixels near enough to be on the same surfaces, some of them beyond a blurred edge."""


def _light(width: int, context: tuple[int, ...]) -> NetworkConfig:
    """Volumes of sectors for any arrangement of views, in one size."""
    search = StageConfig(
        sampled(-4.0, 4.0, 1 / 4),
        volume="sectors",
        aggregation=None,
        attention=False,
        semi_global=SemiGlobalConfig(),
    )
    choice = StageConfig(
        volume="sectors",
        aggregation=Choice(width, context),
        occlusion="coarse",
        attention=False,
        plane_steps=3,
        neighbours=_AROUND,
        window=0.15,
    )
    return NetworkConfig((search, choice), views=None, features=DerivativeFeatures())


_COARSE_9, _COARSE_17, _COARSE_33 = (sampled(-4.0, 4.0, step) for step in (1.0, 1 / 2, 1 / 4))


def _single_stage(interval: float) -> NetworkConfig:
    """LFattNet and SubFocal: one stage of 150 channels, 170 hidden units of attention."""
    stage = StageConfig(sampled(-4.0, 4.0, interval), aggregation=Residual(width=150))
    return NetworkConfig((stage,), attention_width=170)


PRESETS: Mapping[str, NetworkConfig] = MappingProxyType(
    {
        # Table 3 of the paper, row by row.
        "cas_1": _cascade(_COARSE_9),
        "cas_2": _cascade(_COARSE_9, _around(1 / 8)),
        "cas_3": _cascade(_COARSE_9, _around(1 / 8), _around(1 / 16)),
        "cas_4": _cascade(_COARSE_9, _around(1 / 8), _around(1 / 16), _around(1 / 32)),
        "cas_2_share": _cascade(_COARSE_9, _around(1 / 8), shared_aggregation=True),
        "cas_2_occ": _cascade(_COARSE_9, _around(1 / 8), occlusion="coarse"),
        "cas_2_occ_gt": _cascade(_COARSE_9, _around(1 / 8), occlusion="ground_truth"),
        "cas_2_interval_1_2": _cascade(_COARSE_9, _around(1 / 2)),
        "cas_2_interval_1_4": _cascade(_COARSE_9, _around(1 / 4)),
        "cas_2_interval_1_8": _cascade(_COARSE_9, _around(1 / 8)),
        "cas_2_interval_1_16": _cascade(_COARSE_9, _around(1 / 16)),
        "cas_2_coarse_17": _cascade(_COARSE_17, _around(1 / 8)),
        "cas_2_coarse_33": _cascade(_COARSE_33, _around(1 / 8)),
        # The final model: Cas_2-occ with 33 and 9 candidates.
        "occcasnet": _cascade(_COARSE_33, _around(1 / 8), occlusion="coarse"),
        # Single-stage volumes of the networks it is compared with.
        "lfattnet": _single_stage(1.0),
        "subfocal": _single_stage(1 / 10),
        # For any arrangement of views, without a GPU; in three sizes.
        "light_small": _light(16, (24, 24, 32, 32)),
        "light": _light(32, (48, 48, 64, 64)),
        "light_large": _light(64, (64, 64, 96, 96)),
        # Same structure as the final model, small enough for tests.
        "tiny": NetworkConfig(
            (
                StageConfig(sampled(-2.0, 2.0, 1.0), aggregation=Residual(8, 1)),
                StageConfig(
                    sampled(-0.5, 0.5, 0.5), aggregation=Residual(8, 1), occlusion="coarse"
                ),
            ),
            views=(3, 3),
            features=FeatureConfig(blocks=(1, 1, 1, 1), pooled=(2, 4)),
            attention_width=8,
        ),
    }
)


def preset(name: str, **changes) -> NetworkConfig:
    """A network of the paper by its name, with fields replaced on request.

    Args:
        name: One of :data:`PRESETS`.
        **changes: Fields of :class:`NetworkConfig` to replace, for instance ``warp="transposed"``.

    Returns:
        The configuration.

    Raises:
        InputError: If there is no such preset.

    Example:
        >>> [len(stage.candidates) for stage in preset("occcasnet").stages]
        [33, 9]
    """
    if name not in PRESETS:
        raise InputError(f"there is no network named {name!r}; there are {', '.join(PRESETS)}")
    return replace(PRESETS[name], **changes)
