"""Configuration of OccCasNet and of the paper's variants."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from occjax.errors import check_one_of

OcclusionSource = Literal["none", "coarse", "ground_truth", "visibility"]
VolumeKind = Literal["concatenate", "statistics", "correlation"]
Warp = Literal["correct", "transposed"]
FeatureStatistics = Literal["pooled", "per_view"]


@dataclass(frozen=True)
class FeatureConfig:
    """Feature network, applied to each view.

    Attributes:
        stem: Channels of the first two convolutions.
        widths: Channels of each group of residual blocks.
        blocks: Number of residual blocks in each group.
        dilations: Dilation of both convolutions of a group's blocks.
        pooled: Side lengths of the average pooling of the spatial pyramid, in pixels.
        pooled_width: Channels of each branch of the pyramid.
        fused: Channels of the convolution over the concatenated branches.
        channels: Channels of the feature map that enters the cost volume.
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
        """Check that all groups are fully described."""
        if not len(self.widths) == len(self.blocks) == len(self.dilations) >= 2:
            raise ValueError(
                "widths, blocks and dilations must describe the same two or more groups, not "
                f"{len(self.widths)}, {len(self.blocks)} and {len(self.dilations)}"
            )


@dataclass(frozen=True)
class AggregationConfig:
    """Aggregation of a cost volume by 3-D convolutions at one resolution.

    Attributes:
        width: Channels of the inner layers.
        pairs: Number of residual blocks; each has two convolutions.
    """

    width: int = 96
    pairs: int = 2

    @property
    def halo(self) -> int:
        """Radius of the receptive field, in pixels."""
        return 2 * self.pairs + 4


@dataclass(frozen=True)
class StageConfig:
    """One stage of the cascade.

    Attributes:
        candidates: Disparities of the first stage, or residuals around the disparity of the stage
            before, in pixels per view step; ascending.
        volume: ``"concatenate"`` concatenates the features of all views (eqs. 2, 3 and 8).
            ``"statistics"`` keeps their mean and variance over the views
            (:func:`occjax.ops.mean_and_variance`), ``"correlation"`` the mean correlation of the
            views with the centre view, by groups of channels
            (:func:`occjax.ops.group_correlation`); such volumes have no channels of single views
            to attend to.
        aggregation: Aggregation of the volume into a score for each candidate.
        occlusion: Source of the occlusion weights: none (no weights); photo-consistency at the
            disparity of the stage before (``"coarse"``) or at the true disparity
            (``"ground_truth"``, the paper's upper bound); or ``"visibility"``, weights of 1 and 0
            from the exact visibility of procedural light fields, for training and study.
        attention: Whether channel attention weighs each view.
    """

    candidates: tuple[float, ...]
    volume: VolumeKind = "concatenate"
    aggregation: AggregationConfig = AggregationConfig()
    occlusion: OcclusionSource = "none"
    attention: bool = True

    def __post_init__(self) -> None:
        """Accept candidates as any sequence and check the fields."""
        object.__setattr__(self, "candidates", tuple(map(float, self.candidates)))
        if len(self.candidates) < 2 or sorted(set(self.candidates)) != list(self.candidates):
            raise ValueError(f"candidates must be two or more, ascending, not {self.candidates}")
        check_one_of("volume", self.volume, VolumeKind)
        check_one_of("occlusion", self.occlusion, OcclusionSource)
        if self.volume != "concatenate" and self.attention:
            raise ValueError(
                f"a volume of {self.volume} has no channels of single views; set attention=False"
            )


@dataclass(frozen=True)
class OccCasNetConfig:
    """A cascade of cost volumes on a fixed grid of views.

    Attributes:
        stages: The stages in order; the first samples the whole disparity range.
        views: ``(V, U)``, size of the grid of views.
        features: The feature network.
        attention_width: Hidden units of the channel attention of each stage.
        shared_aggregation: Whether all stages share one attention and one aggregation (the paper's
            ``Cas_2-share``, which has as many parameters as a single stage).
        warp: ``"correct"``, or ``"transposed"`` for weights trained by the published code, whose
            occlusion maps and refined volume move rows with u and columns with v.
        feature_statistics: Samples over which BatchNorm of the feature network computes its
            statistics in training: ``"pooled"`` over all views of the batch, or ``"per_view"`` as
            in the published code, which calls the network once per view.
        correlation_groups: Groups of feature channels in a volume of correlations; must divide the
            number of channels.
    """

    stages: tuple[StageConfig, ...]
    views: tuple[int, int] = (9, 9)
    features: FeatureConfig = FeatureConfig()
    attention_width: int = 120
    shared_aggregation: bool = False
    warp: Warp = "correct"
    feature_statistics: FeatureStatistics = "pooled"
    correlation_groups: int = 4

    def __post_init__(self) -> None:
        """Check that the network can be built."""
        if not self.stages:
            raise ValueError("a network needs at least one stage")
        check_one_of("warp", self.warp, Warp)
        check_one_of("feature_statistics", self.feature_statistics, FeatureStatistics)
        if self.stages[0].occlusion == "coarse":
            raise ValueError(
                "the first stage cannot compute occlusion from the stage before; "
                'set occlusion="none"'
            )
        v, u = self.views
        if any(stage.attention for stage in self.stages) and (v != u or v % 2 == 0):
            raise ValueError(
                f"channel attention mirrors an octant of a square grid of odd size, not {v}x{u}; "
                "set attention=False in every stage"
            )
        shapes = {(stage.aggregation, stage.attention, stage.volume) for stage in self.stages}
        if self.shared_aggregation and len(shapes) > 1:
            raise ValueError(
                "stages that share an aggregation must agree in width, depth, attention and volume"
            )

    def with_stages(self, **changes: Any) -> OccCasNetConfig:
        """Return the same network with fields of every stage replaced.

        Args:
            **changes: Fields of :class:`StageConfig`.

        Raises:
            ValueError: If such a network cannot be built.

        Example:
            >>> network = OccCasNetConfig((StageConfig((-1.0, 0.0, 1.0)),))
            >>> network.with_stages(attention=False).stages[0].attention
            False
        """
        return replace(self, stages=tuple(replace(stage, **changes) for stage in self.stages))

    def part_index(self, stage: int) -> int:
        """Return the index of the attention and aggregation that a stage uses."""
        return 0 if self.shared_aggregation else stage

    @property
    def depth(self) -> int:
        """Number of residual blocks."""
        return sum(self.features.blocks) + sum(stage.aggregation.pairs for stage in self.stages)

    @property
    def needs_ground_truth(self) -> bool:
        """Whether a stage computes its occlusion maps from the ground truth."""
        return any(stage.occlusion == "ground_truth" for stage in self.stages)

    @property
    def needs_visibility(self) -> bool:
        """Whether a stage takes its occlusion maps from the exact visibility."""
        return any(stage.occlusion == "visibility" for stage in self.stages)
