"""Configuration of ProposalNet and of the training-free estimator.

The training-free estimator is ProposalNet without its selector. The steps, in the order of the
data: exposure, matching costs, semi-global search, refinement by planes, proposals, selection,
support, residual, planar surfaces, voting.

Grey levels are relative to ``ExposureConfig.white``. Disparities are in pixels per view step of a
light field whose largest view offset is ``ProposalNetConfig.reach``.
"""

from __future__ import annotations

from dataclasses import dataclass

from occjax.view_selection import Arrangement


@dataclass(frozen=True)
class ExposureConfig:
    """Normalisation of brightness.

    Attributes:
        white: Grey level that the 99th percentile of the centre view is scaled to.
        vignette: Grey level up to which pixels that are connected to the image border along a row
            or a column count as vignetted. Their matching costs are ignored.
    """

    white: float = 0.8
    vignette: float = 0.01


@dataclass(frozen=True)
class NoiseConfig:
    """Estimate of image noise, and how strongly it affects the matching costs.

    Attributes:
        window_radius_px: Radius of the windows in which views are compared.
        quantile: Quantile over the windows that gives the noise level. A low quantile leaves out
            occlusions and texture too fine to interpolate.
        texture_margin: Factor on the variance that noise gives to derivatives. Variance below the
            product counts as noise.
        reference_level: Standard deviation of the noise, in grey levels, at which it has half of
            its effect. The default is twice the level that rounding to 8 bits causes.
        steepness: Steepness of the transition from clean to noisy: with the default, noise at half
            the reference level has no effect, noise at twice that level has full effect.
    """

    window_radius_px: int = 4
    quantile: float = 0.25
    texture_margin: float = 1.3
    reference_level: float = 0.002
    steepness: int = 8


@dataclass(frozen=True)
class CostConfig:
    """Truncated matching costs.

    Attributes:
        grey_truncation: Grey difference above which the cost is constant.
        derivative_truncation: The same for the derivatives of grey, per pixel.
        blurred_truncation: The same for blurred grey.
        window_radius_px: Radius of the window over which costs are averaged before the best part
            of the aperture is chosen.
    """

    grey_truncation: float = 0.02
    derivative_truncation: float = 0.004
    blurred_truncation: float = 0.003
    window_radius_px: int = 1


@dataclass(frozen=True)
class SearchConfig:
    """Semi-global search for the disparity of least cost.

    Attributes:
        downsampling: Factor by which the views are downsampled for the search, 1 or 2.
        interval: Spacing of the candidates.
        default_limit: Largest absolute disparity of the default range.
        smoothness: Penalty of a disparity that changes by one pixel per view step between
            neighbouring pixels of the search.
        max_edge_penalty: Penalty of a depth edge where the image has no edge.
        edge_contrast: Grey difference of neighbouring pixels that reduces the penalty of a depth
            edge by a factor e.
        temperature: Cost difference that reduces the probability of a candidate by a factor e. It
            affects confidence and standard deviation, not disparity.
        context_radius_px: Radius of the edge-aware mean of the costs, in pixels of the search.
            Where the images are noisy, it is added to the costs, because noisy surfaces without
            texture need many pixels. Along the surface that is found, it decides between
            neighbouring candidates. 0 disables both.
        context_edge: Grey difference that bounds this mean.
    """

    downsampling: int = 2
    interval: float = 0.25
    default_limit: float = 4.0
    smoothness: float = 0.3
    max_edge_penalty: float = 1.0
    edge_contrast: float = 0.03
    temperature: float = 0.1
    context_radius_px: float = 30.0
    context_edge: float = 0.03

    def __post_init__(self) -> None:
        """Check the factor of downsampling."""
        if self.downsampling not in (1, 2):
            raise ValueError(f"downsampling must be 1 or 2, not {self.downsampling}")


@dataclass(frozen=True)
class RefinementConfig:
    """Sub-pixel refinement by Lucas-Kanade steps and fitted planes.

    Attributes:
        steps: Number of steps; 0 disables the refinement.
        radius_px: Radius of the fitted planes where there are no edges.
        guide_edge: Grey difference that bounds a plane.
        disparity_edge: Disparity difference that bounds a plane.
        view_variation: Standard deviation of grey between views that neither noise nor disparity
            explains, for example by highlights and vignetting.
        min_gradient: Grey gradient per pixel that every view is assumed to have at least. It keeps
            the disparity of pixels without texture, and gives them a small weight in the planes.
    """

    steps: int = 3
    radius_px: float = 12.0
    guide_edge: float = 0.03
    disparity_edge: float = 0.15
    view_variation: float = 0.01
    min_gradient: float = 1e-3


NEAR_AND_FAR = (
    *((-4, 0), (4, 0), (0, -4), (0, 4)),
    *((-10, -10), (-10, 10), (10, -10), (10, 10)),
)
"""Offsets ``(row, column)`` of the proposing neighbours, in pixels. The near ones often lie on the
same surface, the far ones beyond a blurred edge."""


@dataclass(frozen=True)
class ProposalsConfig:
    """Disparities that are proposed for each pixel, and their costs.

    Attributes:
        offsets: Offsets ``(row, column)`` of the neighbours whose disparity is proposed, in pixels;
            closed under reflection and transposition (the propagation of PatchMatch Stereo, Bleyer
            et al., BMVC 2011).
        min_second_distance: Smallest distance of the second-best disparity of the search, which is
            proposed too, from the best one.
        slope_step_px: Distance over which the slope of a surface is measured.
        grey_tolerance: Grey difference at which the robust cost of a view is one half.
        detail_tolerance: The same for grey minus its local mean.
        max_aggregated_cost: Aggregated cost of the search, relative to that of the best candidate,
            above which the cost channel is constant.
    """

    offsets: tuple[tuple[int, int], ...] = NEAR_AND_FAR
    min_second_distance: float = 0.7
    slope_step_px: int = 8
    grey_tolerance: float = 0.03
    detail_tolerance: float = 0.01
    max_aggregated_cost: float = 2.0

    def __post_init__(self) -> None:
        """Check the symmetry of the offsets, which augmentation relies on."""
        offsets = set(self.offsets)
        if {(-row, column) for row, column in offsets} != offsets or {
            (column, row) for row, column in offsets
        } != offsets:
            raise ValueError("offsets must contain the reflections and transpositions of each one")
        if (0, 0) in offsets or len(offsets) < len(self.offsets):
            raise ValueError("offsets must be different from each other and from (0, 0)")


@dataclass(frozen=True)
class SelectorConfig:
    """The learned part: selection among the proposals of each pixel.

    Attributes:
        width: Channels of the convolutions that are applied to each proposal, at half resolution.
        context: Channels of the convolutions over all proposals of a pixel, one entry for each
            level: the first has half resolution, each further one half of that before it.
        window: Distance from the most likely proposal within which proposals are averaged. A small
            window does not mix two surfaces.
        cost_floor: Cost below which differences between proposals are noise.
        similarity: Difference of two disparities, or of two grey levels, at which the similarity
            feature is one half.
        initial_bias: Score of the first proposal, the refined disparity, before training. All other
            proposals start with score 0.
    """

    width: int = 32
    context: tuple[int, ...] = (48, 48, 64, 64)
    window: float = 0.15
    cost_floor: float = 0.003
    similarity: float = 0.05
    initial_bias: float = 3.0


def _check_window(radius_px: int, step_px: int) -> None:
    """Check that evenly spaced pixels of a window contain its centre."""
    if step_px < 1 or radius_px < 0 or radius_px % step_px:
        raise ValueError(f"radius_px must be a multiple of step_px, not {radius_px} and {step_px}")


@dataclass(frozen=True)
class SupportConfig:
    """Support of the proposals of a pixel by the pixels around it that look alike.

    Attributes:
        radius_px: Half width of the square window, in pixels; a multiple of ``step_px``.
        step_px: Spacing of the supporting pixels in the window, in pixels.
        appearance_scale: Difference of colour or grey, as a mean over the channels, that reduces
            the support of a pixel by ``exp(-1)``.
        disparity_scale: Difference from the surface of a pixel at which its support is halved.
        exponent: Power of the support in its product with the probability of a proposal.
        floor: Positive number that is added to the support.
    """

    radius_px: int = 36
    step_px: int = 9
    appearance_scale: float = 0.01
    disparity_scale: float = 0.1
    exponent: float = 0.8
    floor: float = 1e-5

    def __post_init__(self) -> None:
        """Check that the window contains its centre, and that no support is zero."""
        _check_window(self.radius_px, self.step_px)
        # With a floor of 0, all proposals of a blank image would have the probability 0 / 0.
        if min(self.appearance_scale, self.disparity_scale, self.floor) <= 0.0:
            raise ValueError("appearance_scale, disparity_scale and floor must be positive")


@dataclass(frozen=True)
class VotingConfig:
    """Region voting: replaces disparities by those of the pixels around that look alike.

    Attributes:
        radius_px: Half width of the square window, in pixels; a multiple of ``step_px``.
        step_px: Spacing of the voting pixels in the window, in pixels.
        appearance_scale: Difference of colour or grey, as a mean over the channels, that reduces
            the vote of a pixel to a third; at four times this difference it has no vote.
        confidence_power: Power of the confidence of a pixel in its vote.
        min_distance: Smallest distance of the second elected disparity from the first, in pixels
            per view step at the configured reach.
        min_change: Largest difference from the elected disparity at which a pixel keeps its own, in
            the same unit.
        bias: Log-odds that an elected disparity is better, without the following terms.
        votes: Factor on the logarithm of its votes relative to those of the pixel's own disparity.
        cost_increase: Factor on its matching cost minus that of the pixel's own disparity.
        proposal_probability: Factor on the logarithm of the probability of the closest proposal.
    """

    radius_px: int = 36
    step_px: int = 6
    appearance_scale: float = 0.01
    confidence_power: float = 4.0
    min_distance: float = 0.4
    min_change: float = 0.15
    bias: float = 0.78
    votes: float = 0.58
    cost_increase: float = -7.2
    proposal_probability: float = 0.63

    def __post_init__(self) -> None:
        """Check the ranges of the settings."""
        _check_window(self.radius_px, self.step_px)
        if not min(self.appearance_scale, self.confidence_power) > 0.0:
            raise ValueError("appearance_scale and confidence_power must be positive")
        if not min(self.min_distance, self.min_change) >= 0.0:
            raise ValueError("min_distance and min_change must be 0 or more")


@dataclass(frozen=True)
class ResidualConfig:
    """The second learned part: a residual from a cost volume around the selected disparity.

    Attributes:
        candidates: Candidates relative to the disparity, ascending and symmetric about 0.
        derivative_tolerance: Difference of the derivatives of grey, per pixel, at which their
            robust cost is one half.
        widths: Channels of the convolutions of each level: the first works at half resolution, each
            following one at half the resolution of the one before.
    """

    candidates: tuple[float, ...] = (-0.3, -0.15, -0.06, -0.02, 0.0, 0.02, 0.06, 0.15, 0.3)
    derivative_tolerance: float = 0.004
    widths: tuple[int, ...] = (48, 48, 64, 64)

    def __post_init__(self) -> None:
        """Check the candidates: without training, their mean must be the disparity itself."""
        given = [*self.candidates]
        mirrored = [-each for each in reversed(given)]
        if sorted(set(given)) != given or given != mirrored or 0.0 not in given:
            raise ValueError(f"candidates must be ascending and symmetric about 0, with 0: {given}")


@dataclass(frozen=True)
class PlanarConfig:
    """Planes of large planar surfaces, fitted to the selected disparity.

    Attributes:
        deviation: Expected deviation of a pixel on well-textured surfaces from the plane.
        noise_factor: Factor on the variance of the disparity of a pixel; the expected deviation is
            ``hypot(deviation, noise_factor * variance)``, at most ``max_deviation``.
        max_deviation: Largest expected deviation.
        samples: Samples of the disparity along the longer side of the image.
        seed_step: Spacing of the seeds of planes, in samples.
        radii: Radii of the neighbourhoods that a growing plane is fitted to in turn, in samples.
        steps: Steps of robust least squares with each radius.
        first_tolerance: Deviation, in expected deviations, that reduces the weight of a pixel by
            ``exp(-1 / 2)`` in the first steps.
        tolerance: Deviation, in expected deviations, within which a pixel belongs to a plane.
        border: Factor on the tolerance; pixels within it count as the border of a plane.
        min_isolation: Smallest fraction of the pixels on and around a plane, including its border,
            that belong to it. The border of a plane that touches a curved surface is large.
        max_curvature: Largest fraction of the variance of the deviations from a plane that a
            quadratic function explains. It is large where the surface is gently curved.
        max_planes: Largest number of planes.
        min_area: Smallest area of a plane, as a fraction of the image.
        window_radius_px: Radius of the window in which the pixels of a plane are counted.
        min_density: Smallest fraction of the pixels in this window that belong to the plane.
    """

    deviation: float = 0.01
    noise_factor: float = 2.0
    max_deviation: float = 0.04
    samples: int = 64
    seed_step: int = 3
    radii: tuple[float, ...] = (3.0, 9.0, 27.0, 81.0)
    steps: int = 2
    first_tolerance: float = 3.0
    tolerance: float = 2.0
    border: float = 3.0
    min_isolation: float = 0.7
    max_curvature: float = 0.3
    max_planes: int = 24
    min_area: float = 0.005
    window_radius_px: int = 16
    min_density: float = 0.3


@dataclass(frozen=True)
class ConfidenceConfig:
    """Confidence of the disparity.

    Attributes:
        sufficient_certainty: Certainty of the search above which the confidence before the residual
            is that of the selection. Below it, nothing tells the proposals apart.
        edge_step: Largest minus smallest disparity of 3x3 pixels at which the confidence is halved.
            Without a selector, it is not known which surface a pixel at a depth edge shows.
    """

    sufficient_certainty: float = 0.1
    edge_step: float = 0.1


@dataclass(frozen=True)
class ProposalNetConfig:
    """ProposalNet, or with ``selector=None`` the training-free estimator.

    Attributes:
        exposure: Normalisation of brightness.
        noise: Estimate of image noise.
        costs: Matching costs.
        search: Semi-global search.
        refinement: Sub-pixel refinement.
        proposals: Proposals and their costs.
        selector: Learned selection; None skips proposals and selection.
        support: Support of the proposals by the pixels around each pixel; None keeps the
            probabilities of the selector.
        residual: Learned residual of the selected disparity; None skips it.
        planar: Planes of large planar surfaces; None keeps the disparity without them.
        voting: Replacement of disparities by those of the pixels around; None skips it, as does
            ``selector=None``.
        confidence: Confidence of the disparity.
        views: Views of a grid that are compared with the centre view. The two outermost views in
            eight directions carry most of the information.
        reach: Largest view offset that every arrangement of views is scaled to, in view steps. A
            light field with twice the view spacing shows the same scene at half the disparity.
        max_candidates: Largest number of candidates of the search.
    """

    exposure: ExposureConfig = ExposureConfig()
    noise: NoiseConfig = NoiseConfig()
    costs: CostConfig = CostConfig()
    search: SearchConfig = SearchConfig()
    refinement: RefinementConfig = RefinementConfig()
    proposals: ProposalsConfig = ProposalsConfig()
    selector: SelectorConfig | None = SelectorConfig()
    support: SupportConfig | None = SupportConfig()
    residual: ResidualConfig | None = None
    planar: PlanarConfig | None = PlanarConfig()
    voting: VotingConfig | None = VotingConfig()
    confidence: ConfidenceConfig = ConfidenceConfig()
    views: Arrangement = "outer_star"
    reach: float = 4.0
    max_candidates: int = 1024

    def __post_init__(self) -> None:
        """Check that the selector gets the search at its own resolution."""
        if self.selector is not None and self.search.downsampling != 2:
            raise ValueError(
                "the selector works at half resolution and needs search.downsampling=2, not "
                f"{self.search.downsampling}; set selector=None to search at full resolution"
            )
        if self.selector is None and self.residual is not None:
            raise ValueError("the residual needs a selector; set residual=None too")

    @property
    def size_multiple(self) -> int:
        """Number of pixels that height and width are padded to a multiple of."""
        selector, residual = self.selector, self.residual
        return max(
            self.search.downsampling,
            2 ** len(selector.context) if selector else 1,
            2 ** len(residual.widths) if residual else 1,
        )


PRESETS: dict[str, ProposalNetConfig] = {
    "proposal": ProposalNetConfig(residual=ResidualConfig()),
    "proposal_small": ProposalNetConfig(
        selector=SelectorConfig(16, (24, 24, 32, 32)),
        residual=ResidualConfig(widths=(24, 24, 32, 32)),
    ),
    "proposal_large": ProposalNetConfig(
        selector=SelectorConfig(64, (64, 64, 96, 96)),
        residual=ResidualConfig(widths=(64, 64, 96, 96)),
    ),
    # Without a selector that corrects depth edges, full resolution and all views are better:
    # BadPix 0.07 of HCI antinous 3.2 % instead of 4.0 %, of the bundled sample 7.3 % instead of
    # 8.7 %. The penalties are doubled, because a path sums the costs of twice as many pixels. The
    # context mean blurs depth edges at full resolution.
    "photometric": ProposalNetConfig(
        search=SearchConfig(
            downsampling=1,
            interval=0.1,
            smoothness=0.6,
            max_edge_penalty=2.0,
            context_radius_px=0.0,
        ),
        selector=None,
        support=None,
        voting=None,
        planar=None,
        views="all",
    ),
}
"""Configurations by model name."""
