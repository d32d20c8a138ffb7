"""What a network is made of: frozen dataclasses, and the paper's variants by name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal, get_args

from occjax.errors import InputError

OcclusionSource = Literal["none", "coarse", "ground_truth"]
Warp = Literal["correct", "transposed"]
FeatureStatistics = Literal["pooled", "per_view"]


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


@dataclass(frozen=True)
class FeatureConfig:
    """The feature network, applied to each view alone.

    Attributes:
        stem: Channels of the two first convolutions.
        widths: Channels of each group of residual blocks.
        blocks: Number of residual blocks in each group.
        dilations: Dilation of both convolutions of a group's blocks.
        pooled: Side lengths of the spatial pyramid's average pooling, in pixels.
        pooled_width: Channels of each branch of the pyramid.
        fused: Channels of the convolution over the concatenated branches.
        channels: Channels of the feature map that goes into the volume.
    """

    stem: int = 4
    widths: tuple[int, ...] = (4, 8, 16, 16)
    blocks: tuple[int, ...] = (2, 8, 2, 2)
    dilations: tuple[int, ...] = (1, 1, 1, 2)
    pooled: tuple[int, ...] = (2, 4, 8, 16)
    pooled_width: int = 4
    fused: int = 16
    channels: int = 4

    def __post_init__(self) -> None:
        """Refuse what cannot be built."""
        if not len(self.widths) == len(self.blocks) == len(self.dilations) >= 2:
            raise ValueError(
                "widths, blocks and dilations must be given for the same two or more groups, not "
                f"for {len(self.widths)}, {len(self.blocks)} and {len(self.dilations)}"
            )


@dataclass(frozen=True)
class StageConfig:
    """One stage of the cascade.

    Attributes:
        candidates: Disparities of the first stage, or residuals around the stage before it, in
            pixels per view step.
        width: Channels of the aggregation's 3-D convolutions.
        residual_pairs: Residual blocks of the aggregation, two convolutions each.
        occlusion: Disparity from which occlusion weights are made: none (no weights), that of the
            stage before (``"coarse"``), or the ground truth (the paper's upper bound).
        attention: Weight each view by channel attention.
    """

    candidates: tuple[float, ...]
    width: int = 96
    residual_pairs: int = 2
    occlusion: OcclusionSource = "none"
    attention: bool = True

    def __post_init__(self) -> None:
        """Take candidates of any sequence; refuse what cannot be built."""
        object.__setattr__(self, "candidates", tuple(map(float, self.candidates)))
        if len(self.candidates) < 2 or sorted(set(self.candidates)) != list(self.candidates):
            raise ValueError(f"candidates must be two or more, ascending, not {self.candidates}")
        _one_of("occlusion", self.occlusion, OcclusionSource)

    @property
    def halo(self) -> int:
        """Pixels on each side on which one pixel of the aggregated volume depends."""
        return 2 * self.residual_pairs + 4


@dataclass(frozen=True)
class NetworkConfig:
    """A cascade of cost volumes.

    Attributes:
        stages: The stages in order; the first samples the whole disparity range.
        views: ``(V, U)`` size of the grid of views.
        features: The feature network.
        attention_width: Hidden units of each stage's channel attention.
        shared_aggregation: All stages share one attention and one aggregation (the paper's
            ``Cas_2-share``, whose parameter count is that of a single stage).
        warp: ``"correct"``, or ``"transposed"`` for weights trained by the published code, whose
            occlusion maps and refined volume move rows with u and columns with v.
        feature_statistics: Over what BatchNorm of the feature network takes its statistics while
            training: ``"pooled"`` over all views of the batch, or ``"per_view"`` as in the
            published code, which calls the network once per view.
    """

    stages: tuple[StageConfig, ...]
    views: tuple[int, int] = (9, 9)
    features: FeatureConfig = FeatureConfig()
    attention_width: int = 120
    shared_aggregation: bool = False
    warp: Warp = "correct"
    feature_statistics: FeatureStatistics = "pooled"

    def __post_init__(self) -> None:
        """Refuse what cannot be built."""
        if not self.stages:
            raise ValueError("a network needs at least one stage")
        _one_of("warp", self.warp, Warp)
        _one_of("feature_statistics", self.feature_statistics, FeatureStatistics)
        if self.stages[0].occlusion == "coarse":
            raise ValueError("the first stage has no disparity before it to judge occlusion by")
        v, u = self.views
        if any(stage.attention for stage in self.stages) and (v != u or v % 2 == 0):
            raise ValueError(
                f"channel attention mirrors an octant of a square grid of odd size, not {v}x{u}; "
                "set attention=False in every stage"
            )
        shapes = {(stage.width, stage.residual_pairs, stage.attention) for stage in self.stages}
        if self.shared_aggregation and len(shapes) > 1:
            raise ValueError(
                "stages that share an aggregation must agree in width, depth and attention"
            )


def _one_of(name: str, value: str, choices: Any) -> None:
    """A misspelt option would otherwise silently mean the other one."""
    if value not in get_args(choices):
        raise ValueError(f"{name} is {' or '.join(get_args(choices))}, not {value!r}")


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


_COARSE_9, _COARSE_17, _COARSE_33 = (sampled(-4.0, 4.0, step) for step in (1.0, 1 / 2, 1 / 4))

_WIDE = 150  # LFattNet and SubFocal aggregate with 150 channels

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
        "lfattnet": NetworkConfig((StageConfig(_COARSE_9, width=_WIDE),)),
        "subfocal": NetworkConfig((StageConfig(sampled(-4.0, 4.0, 1 / 10), width=_WIDE),)),
        # Same structure as the final model, small enough for tests.
        "tiny": NetworkConfig(
            (
                StageConfig(sampled(-2.0, 2.0, 1.0), width=8, residual_pairs=1),
                StageConfig(sampled(-0.5, 0.5, 0.5), width=8, residual_pairs=1, occlusion="coarse"),
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
