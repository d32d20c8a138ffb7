"""What a network is made of: frozen dataclasses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import NoneType
from typing import Any, Literal, TypeVar, get_args

OcclusionSource = Literal["none", "coarse", "ground_truth"]
VolumeKind = Literal["concatenate", "statistics", "sectors"]
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
    """Semi-global aggregation, at half resolution.

    Attributes:
        smoothness: Cost of a disparity that changes by one pixel per view step from one pixel of
            half resolution to the next.
        jump: Greatest cost of a depth edge, where the image has none.
        edge: Grey difference between neighbouring pixels over which a depth edge becomes cheaper by
            a factor e.
        temperature: Difference of cost over which a candidate becomes less probable by a factor e,
            unless what is learned corrects it.
    """

    smoothness: float = 0.3
    jump: float = 1.0
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
class Choice:
    """Choice among the proposals of each pixel (:class:`occjax.models.choice.ProposalChoice`).

    Attributes:
        width: Channels of the convolutions that all proposals share, at half resolution.
        context: Channels of those that see all proposals of a pixel at once: at half resolution,
            and at a half of that for each further entry.
    """

    width: int = 32
    context: tuple[int, ...] = (48, 48, 64, 64)


AggregationConfig = Residual | Choice | None


@dataclass(frozen=True)
class StageConfig:
    """One stage of the cascade.

    Attributes:
        candidates: Disparities of the first stage, or residuals around the stage before it, in
            pixels per view step; a stage that makes a ``Choice`` has none.
        volume: ``"concatenate"`` the features of all views (eqs. 2, 3 and 8); ``"statistics"``,
            their mean and variance over the views (:func:`occjax.ops.mean_and_variance`), in which
            no channel is left of a single view to attend to; or costs in eight ``"sectors"`` of the
            aperture (:mod:`occjax.ops.sectors`), for any arrangement of views.
        aggregation: From the volume to a score for each candidate; None for a first volume of
            sectors, which is aggregated semi-globally.
        occlusion: Disparity from which occlusion weights are made: none (no weights), that of the
            stage before (``"coarse"``), or the ground truth (the paper's upper bound).
        attention: Weight each view by channel attention.
        semi_global: What a first volume of sectors is aggregated by.
        plane_steps: Before a choice, Lucas-Kanade steps with planes fitted to each.
        neighbours: For a choice, how far away, ``(rows, columns)``, are the pixels whose disparity
            is proposed too: across an edge it is the right one (the propagation of PatchMatch
            stereo, Bleyer et al., BMVC 2011). With each place its mirror images.
        second: For a choice, how far from the cheapest candidate of the first stage the second one
            that is proposed must be, pixels per view step.
        window: Distance from the likeliest candidate, pixels per view step, within which candidates
            are averaged, so that two surfaces are not; all by default (eq. 10).
    """

    candidates: tuple[float, ...] = ()
    volume: VolumeKind = "concatenate"
    aggregation: AggregationConfig = Residual()
    occlusion: OcclusionSource = "none"
    attention: bool = True
    semi_global: SemiGlobalConfig | None = None
    plane_steps: int = 0
    neighbours: tuple[tuple[int, int], ...] = ()
    second: float = 0.7
    window: float | None = None

    def __post_init__(self) -> None:
        """Take candidates of any sequence; refuse what cannot be built."""
        object.__setattr__(self, "candidates", tuple(map(float, self.candidates)))
        chooses = isinstance(self.aggregation, Choice)
        few = len(self.candidates) < 2 or sorted(set(self.candidates)) != list(self.candidates)
        if chooses and self.candidates:
            raise ValueError("a stage that makes a Choice proposes; it has no candidates")
        if few and not chooses:
            raise ValueError(f"candidates must be two or more, ascending, not {self.candidates}")
        _one_of("volume", self.volume, VolumeKind)
        _one_of("occlusion", self.occlusion, OcclusionSource)
        if (self.volume == "sectors") == isinstance(self.aggregation, Residual):
            raise ValueError("a volume of sectors is aggregated by a Choice or not at all")
        if self.volume == "sectors" and (self.attention or self.occlusion == "ground_truth"):
            raise ValueError("a volume of sectors has no attention and takes no ground truth")
        if self.volume == "statistics" and self.attention:
            raise ValueError("a volume of statistics has no channels of single views to attend to")
        if (self.neighbours or self.plane_steps) and not chooses:
            raise ValueError("neighbours and plane_steps are those of a Choice")
        places = set(self.neighbours)
        if {(-row, column) for row, column in places} != places or {
            (column, row) for row, column in places
        } != places:
            raise ValueError("neighbours must hold with each place its mirror images")
        if (0, 0) in places or len(places) < len(self.neighbours):
            raise ValueError("neighbours must be different places, without the pixel itself")


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
    """

    stages: tuple[StageConfig, ...]
    views: tuple[int, int] | None = (9, 9)
    features: FeatureConfig | DerivativeFeatures = FeatureConfig()
    attention_width: int = 120
    shared_aggregation: bool = False
    warp: Warp = "correct"
    feature_statistics: FeatureStatistics = "pooled"
    reach: float = 4.0

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
        kinds = [(type(stage.semi_global), type(stage.aggregation)) for stage in self.stages]
        if kinds != [(SemiGlobalConfig, NoneType), (NoneType, Choice)]:
            raise ValueError(
                "volumes of sectors are two: one aggregated semi-globally, then one for a Choice"
            )
        if not isinstance(self.features, DerivativeFeatures):
            raise ValueError("volumes of sectors compare DerivativeFeatures")
        if self.shared_aggregation or self.warp != "correct":
            raise ValueError("volumes of sectors have no shared aggregation and no transposed warp")

    def _check_grid(self, v: int, u: int) -> None:
        if isinstance(self.features, DerivativeFeatures):
            raise ValueError("DerivativeFeatures need volumes of sectors")
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

    def with_stages(self, **changes) -> NetworkConfig:
        """The same network with fields of every stage replaced.

        Args:
            **changes: Fields of :class:`StageConfig`.

        Raises:
            ValueError: If there is no such network.

        Example:
            >>> network = NetworkConfig((StageConfig((-1.0, 0.0, 1.0)),))
            >>> network.with_stages(attention=False).stages[0].attention
            False
        """
        stages = tuple(replace(stage, **changes) for stage in self.stages)
        return replace(self, stages=stages)

    @property
    def multiple(self) -> int:
        """Height and width are padded to a multiple of this many pixels."""
        if self.views is not None:
            return 1
        return 2 ** len(of_kind(self.stages[1].aggregation, Choice).context)


def of_kind(value: Any, kind: type[Part]) -> Part:
    """A part of a configuration that its network has checked to be of this kind."""
    if not isinstance(value, kind):
        raise TypeError(f"{kind.__name__} is needed here, not {type(value).__name__}")
    return value


def _one_of(name: str, value: str, choices: Any) -> None:
    """A misspelt option would otherwise silently mean the other one."""
    if value not in get_args(choices):
        raise ValueError(f"{name} is {' or '.join(get_args(choices))}, not {value!r}")
