"""What a network is made of: frozen dataclasses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, TypeVar, get_args

OcclusionSource = Literal["none", "coarse", "ground_truth"]
VolumeKind = Literal["concatenate", "sectors"]
Warp = Literal["correct", "transposed"]
FeatureStatistics = Literal["pooled", "per_view"]
Part = TypeVar("Part")


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
class DerivativeFeatures:
    """Features that are not learned: grey and its two derivatives.

    Attributes:
        grey_truncation: Grey difference between views that counts as "something else", where the
            99th percentile of the centre view is 0.8.
        derivative_truncation: The same of a derivative, per pixel.
    """

    grey_truncation: float = 0.02
    derivative_truncation: float = 0.004


@dataclass(frozen=True)
class SemiGlobalConfig:
    """Semi-global aggregation, from which the learned one starts.

    Attributes:
        smoothness: Cost of a disparity that changes by one pixel per view step from pixel to pixel.
        jump: Greatest cost of a depth edge, where the image has none.
        edge: Grey difference between neighbouring pixels over which a depth edge becomes cheaper by
            a factor e.
        temperature: Difference of cost over which a candidate becomes less probable by a factor e,
            unless what is learned corrects it.
    """

    smoothness: float = 0.6
    jump: float = 2.0
    edge: float = 0.03
    temperature: float = 0.1


@dataclass(frozen=True)
class Residual:
    """Aggregation by 3-D convolutions at one resolution, as published.

    Attributes:
        width: Channels.
        pairs: Residual blocks, two convolutions each.
    """

    width: int = 96
    pairs: int = 2

    @property
    def halo(self) -> int:
        """Pixels on each side on which one pixel of the aggregated volume depends."""
        return 2 * self.pairs + 4


@dataclass(frozen=True)
class Hourglass:
    """Aggregation by 3-D convolutions at several resolutions, guided by the centre view.

    The finest level has a quarter of the image's resolution. Each level halves height and width,
    never the candidates, so that candidates of any number and range can be aggregated.

    Attributes:
        widths: Channels of each level, the finest first.
        convolutions: Convolutions of each level below the finest on the way down; there is one more
            on the way up.
    """

    widths: tuple[int, ...] = (16, 32, 48, 64)
    convolutions: int = 2


@dataclass(frozen=True)
class Planar:
    """Aggregation by 2-D convolutions at several resolutions, the candidates as channels.

    For refined volumes, whose candidates are always the same.

    Attributes:
        widths: Channels of each level, the finest first.
        convolutions: As those of :class:`Hourglass`.
    """

    widths: tuple[int, ...] = (32, 48, 64, 64, 64)
    convolutions: int = 2


AggregationConfig = Residual | Hourglass | Planar | None


@dataclass(frozen=True)
class RefinementConfig:
    """The last refinement: sectors and fitted planes propose a disparity, the network decides.

    Attributes:
        width: Channels of the convolutions.
        largest_step: Bound of a step, pixels per view step.
    """

    width: int = 32
    largest_step: float = 0.2


@dataclass(frozen=True)
class StageConfig:
    """One stage of the cascade.

    Attributes:
        candidates: Disparities of the first stage, or residuals around the stage before it, in
            pixels per view step.
        volume: ``"concatenate"`` the features of all views (eqs. 2, 3 and 8), or costs in eight
            ``"sectors"`` of the aperture (:mod:`occjax.ops.sectors`), for any arrangement of views.
        aggregation: From the volume to a score for each candidate; None for a first volume of
            sectors whose semi-global aggregation nothing corrects.
        occlusion: Disparity from which occlusion weights are made: none (no weights), that of the
            stage before (``"coarse"``), or the ground truth (the paper's upper bound).
        attention: Weight each view by channel attention.
        semi_global: What a first volume of sectors is aggregated by before the convolutions.
        plane_steps: Lucas-Kanade steps, with planes fitted to each, before a refined volume of
            sectors.
        neighbours: For a refined volume of sectors, how far away, ``(rows, columns)``, are the
            pixels whose disparity is a candidate too: across an edge it is the right one (the
            propagation of PatchMatch stereo, Bleyer et al., BMVC 2011).
        window: Distance from the likeliest candidate, in intervals of the candidates, within which
            candidates are averaged, so that two surfaces are not; all by default (eq. 10).
    """

    candidates: tuple[float, ...]
    volume: VolumeKind = "concatenate"
    aggregation: AggregationConfig = Residual()
    occlusion: OcclusionSource = "none"
    attention: bool = True
    semi_global: SemiGlobalConfig | None = None
    plane_steps: int = 0
    neighbours: tuple[tuple[int, int], ...] = ()
    window: float | None = None

    def __post_init__(self) -> None:
        """Take candidates of any sequence; refuse what cannot be built."""
        object.__setattr__(self, "candidates", tuple(map(float, self.candidates)))
        if len(self.candidates) < 2 or sorted(set(self.candidates)) != list(self.candidates):
            raise ValueError(f"candidates must be two or more, ascending, not {self.candidates}")
        _one_of("volume", self.volume, VolumeKind)
        _one_of("occlusion", self.occlusion, OcclusionSource)
        sectors = self.volume == "sectors"
        if sectors == isinstance(self.aggregation, Residual) or (
            self.aggregation is None and self.semi_global is None
        ):
            raise ValueError(
                "a volume of sectors is aggregated by Hourglass or Planar, no other is"
            )
        if sectors and (self.attention or self.occlusion == "ground_truth"):
            raise ValueError("a volume of sectors has no attention and takes no ground truth")
        if self.neighbours and not isinstance(self.aggregation, Planar):
            raise ValueError("neighbours are candidates of refined volumes of sectors alone")


@dataclass(frozen=True)
class NetworkConfig:
    """A cascade of cost volumes.

    Attributes:
        stages: The stages in order; the first samples the whole disparity range.
        views: ``(V, U)`` size of the grid of views; None for any arrangement of views.
        features: The feature network, or what volumes of sectors compare.
        attention_width: Hidden units of each stage's channel attention.
        shared_aggregation: All stages share one attention and one aggregation (the paper's
            ``Cas_2-share``, whose parameter count is that of a single stage).
        warp: ``"correct"``, or ``"transposed"`` for weights trained by the published code, whose
            occlusion maps and refined volume move rows with u and columns with v.
        feature_statistics: Over what BatchNorm of the feature network takes its statistics while
            training: ``"pooled"`` over all views of the batch, or ``"per_view"`` as in the
            published code, which calls the network once per view.
        reach: Largest offset of a view, in view steps, to which any arrangement is scaled: views
            twice as far apart show the same scene with half the disparity. For ``views=None``.
        refinement: A last step after the stages, or None.
        guide_widths: Channels of what guides the aggregations, from a quarter of the resolution of
            the centre view downwards. For ``views=None``.
    """

    stages: tuple[StageConfig, ...]
    views: tuple[int, int] | None = (9, 9)
    features: FeatureConfig | DerivativeFeatures = FeatureConfig()
    attention_width: int = 120
    shared_aggregation: bool = False
    warp: Warp = "correct"
    feature_statistics: FeatureStatistics = "pooled"
    reach: float = 4.0
    refinement: RefinementConfig | None = None
    guide_widths: tuple[int, ...] = (16, 24, 32, 48)

    def __post_init__(self) -> None:
        """Refuse what cannot be built."""
        if not self.stages:
            raise ValueError("a network needs at least one stage")
        _one_of("warp", self.warp, Warp)
        _one_of("feature_statistics", self.feature_statistics, FeatureStatistics)
        if self.stages[0].occlusion == "coarse":
            raise ValueError("the first stage has no disparity before it to judge occlusion by")
        sectors = {stage.volume == "sectors" for stage in self.stages}
        if len(sectors) > 1 or sectors != {self.views is None}:
            raise ValueError("either all volumes are of sectors and views is None, or neither")
        if self.views is None:
            self._check_any_views()
        else:
            self._check_grid(*self.views)

    def _check_any_views(self) -> None:
        kinds = [type(stage.aggregation) for stage in self.stages]
        if kinds[0] is Planar or kinds[1:] != [Planar] * (len(kinds) - 1):
            raise ValueError("the first volume of sectors needs Hourglass or None, others Planar")
        hourglass = self.stages[0].aggregation
        if isinstance(hourglass, Hourglass) and len(hourglass.widths) > len(self.guide_widths):
            raise ValueError("guide_widths must have as many levels as the Hourglass")
        if not isinstance(self.features, DerivativeFeatures):
            raise ValueError("volumes of sectors compare DerivativeFeatures")
        if [stage.semi_global is None for stage in self.stages] != [False] + [True] * (
            len(kinds) - 1
        ):
            raise ValueError("semi-global aggregation is that of the first volume of sectors")
        if self.shared_aggregation or self.warp != "correct":
            raise ValueError("volumes of sectors have no shared aggregation and no transposed warp")

    def _check_grid(self, v: int, u: int) -> None:
        if self.refinement is not None or isinstance(self.features, DerivativeFeatures):
            raise ValueError("refinement and DerivativeFeatures need volumes of sectors")
        if any(stage.attention for stage in self.stages) and (v != u or v % 2 == 0):
            raise ValueError(
                f"channel attention mirrors an octant of a square grid of odd size, not {v}x{u}; "
                "set attention=False in every stage"
            )
        shapes = {(stage.aggregation, stage.attention) for stage in self.stages}
        if self.shared_aggregation and len(shapes) > 1:
            raise ValueError(
                "stages that share an aggregation must agree in width, depth and attention"
            )

    @property
    def multiple(self) -> int:
        """Height and width are padded to a multiple of this many pixels."""
        if self.views is not None:
            return 1
        levels = [
            len(stage.aggregation.widths) - 1
            for stage in self.stages
            if isinstance(stage.aggregation, Planar)
        ]
        return 2 ** max(len(self.guide_widths) + 1, *levels)


def of_kind(value: Any, kind: type[Part]) -> Part:
    """A part of a configuration that its network has checked to be of this kind."""
    if not isinstance(value, kind):
        raise TypeError(f"{kind.__name__} is needed here, not {type(value).__name__}")
    return value


def _one_of(name: str, value: str, choices: Any) -> None:
    """A misspelt option would otherwise silently mean the other one."""
    if value not in get_args(choices):
        raise ValueError(f"{name} is {' or '.join(get_args(choices))}, not {value!r}")
