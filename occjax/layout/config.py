"""Settings of the measurement of brightness, view order and disparity range."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BrightnessConfig:
    """Settings of :func:`occjax.layout.view_brightness`.

    Attributes:
        size_px: Length of the shorter image side, in pixels, to which the views are reduced.
        windows_per_side: Reduced image sides per radius of the local mean.
        brightness_percentile: Percentile of the grey values of the centre view that is its
            brightness.
        min_grey: Grey value, relative to that brightness, above which pixels are compared.
        min_gain: Brightness relative to the centre view below which a pixel is black.
        dark_fraction: Fraction of black pixels above which a view is too dark.
        equal_gain: Largest deviation of the gains from 1 that counts as equal brightness. Parallax
            alone changes the gains of clean light fields by up to 0.03, and the mean deviation from
            a uniform gain by 0.012.
        fit_steps: Number of steps of the robust fit of a gain that changes over the image.
    """

    size_px: int = 128
    windows_per_side: int = 24
    brightness_percentile: float = 98.0
    min_grey: float = 0.1
    min_gain: float = 0.25
    dark_fraction: float = 0.1
    equal_gain: float = 0.03
    fit_steps: int = 4


@dataclass(frozen=True)
class RegistrationConfig:
    """Settings of the measurement of view spacing, shifts and camera positions.

    Attributes:
        min_spacing_change: Logarithm of the ratio of column to row spacing from which the spacing
            counts as different. Clean light fields measure 0.03 at most.
        max_spacing_spread: Largest quartile distance of the logarithm of the ratio over the pixels.
            Light fields of any spacing have at most 0.13, views with random shifts 0.16 and more.
        min_spacing_fraction: Fraction of the pixels that must show two clear disparities.
        spacing_radius_px: Radius of the mean of the cost for the ratio.
        clear_minimum: Ratio of lowest to mean cost below which a disparity is clear.
        min_shift_px: Shift of a view from which the light field counts as misregistered, in pixels
            of the light field. Rendered ones have at most 0.04, one of a Lytro Illum 0.1.
        suspicious_shift_px: Shift in the first measurement from which the full measurement is made.
            It is below ``min_shift_px`` because the first measurement underestimates shifts.
        min_position_px: Displacement by a wrong camera position from which the light field counts
            as misregistered: its standard deviation over the image, in pixels of the light field.
            Clean light fields have at most 0.06.
        min_correction_px: Shifts below this are left as they are: resampling costs sharpness.
        significance: Standard errors that a shift must have to be corrected.
        min_improvement: Fraction by which a correction must lower the loss of its view. A measured
            spacing must lower the mean grey difference of all views by the same fraction.
        max_loss_ratio: Ratio of the loss of a view to that of views equally far from the centre
            view from which it may be displaced too far for the first measurement. Clean light
            fields have at most 1.25.
        min_crop_size_px: Shorter side of the middle half of the reduced images from which that half
            is measured before the whole images. If it shows no displaced view, the whole images are
            not measured.
        min_size_px: Shorter image side below which images are not reduced further.
        rounds: Number of rounds of the first measurement, which decides whether the views need
            corrections, and of the full measurement at each resolution.
        residual_scale: Grey difference, relative to the contrast of the centre view, at which a
            pixel has the weight 1/4.
    """

    min_spacing_change: float = 0.06
    max_spacing_spread: float = 0.15
    min_spacing_fraction: float = 0.02
    spacing_radius_px: int = 3
    clear_minimum: float = 0.4
    min_shift_px: float = 0.2
    suspicious_shift_px: float = 0.12
    min_position_px: float = 0.2
    min_correction_px: float = 0.1
    significance: float = 5.0
    min_improvement: float = 0.02
    max_loss_ratio: float = 1.3
    min_crop_size_px: int = 64
    min_size_px: int = 24
    rounds: tuple[int, int] = (2, 4)
    residual_scale: float = 0.4


@dataclass(frozen=True)
class ViewOrderConfig:
    """Settings of :func:`occjax.layout.check`.

    Grey values and grey differences are relative to the brightness of the centre view, so that no
    threshold depends on the exposure. Radii are half widths of square windows, in pixels of the
    reduced images.

    Attributes:
        view_steps: Distances from the centre view, in views, of the views that are compared on each
            arm of the cross. Near views allow large disparities, far views give precision.
        nearest_views: Number of views next to the centre view that are compared under each
            hypothesis on the arrangement of the views.
        coarse_size_px: Maximum length of the shorter image side in the search over all disparities.
        fine_size_px: Maximum length of the shorter image side in the final measurement.
        brightness_percentile: Percentile of the grey values of the centre view that is its
            brightness.
        high_pass_radius_px: Radius of the local mean that is subtracted from each view, against
            vignetting.
        max_motion: Maximum motion between the centre view and the outermost compared view, as a
            fraction of the shorter image side.
        max_disparity: Maximum disparity, in shorter image sides per view step, of the first search.
        max_wide_disparity: Maximum disparity, in the same unit, of a second search that compares
            only the nearest views. Its result is used if enough pixels need such disparities.
        max_wide_candidates: Maximum number of disparity candidates of the second search.
        min_fraction_beyond: Fraction of the pixels that must need disparities of the second search.
        max_disparity_px: Maximum disparity in pixels per view step, in place of ``max_disparity``
            and ``max_wide_disparity``; None for these.
        max_candidates: Maximum number of disparity candidates.
        candidate_motion_px: Minimum motion of the outermost compared view from one candidate to the
            next, in pixels of the reduced images.
        cost_radii_px: Radius of the mean of the cost, for arms of one view, of two views and so on.
            Fewer views need a larger window.
        noise_floor: Mean grey differences that differ by less than this count as equal.
        clearly_worse_ratio: Ratio of two mean grey differences above which one is clearly worse.
            Correct and wrong view orders of real light fields differ by factors of 1.4 to 4.
        alike_ratio: Ratio of two mean grey differences below which both arrangements that the
            names of the views allow are possible. Real light fields reach at least 1.1 for the
            wrong one.
        window_radii_px: Radii of the additional mean of the cost in which disparities are measured.
            Weak texture needs large windows, thin surfaces need small ones.
        clear_minimum: Ratio of lowest to mean cost below which a disparity is reliable, whatever
            the noise.
        significance: Standard deviations of the noise by which the lowest cost must be below the
            mean cost for a disparity to be reliable.
        max_noise_fraction: Fraction of the textured pixels that may look reliable in pure noise.
        min_group_fraction: Fraction of the reliable disparities below which a group apart from all
            others is an outlier, for instance from repeated texture.
        range_percentiles: Percentiles of the reliable disparities that bound the range.
        sufficient_fraction: Fraction of reliably measured pixels below which the range is widened.
        range_step: The range is rounded outwards to multiples of this, in pixels per view step.
        unknown_range: Range if nothing can be measured, in pixels per view step; that of the
            published network.
        min_collision_px: Minimum distance of two points of the centre view that meet in one pixel
            of another view, so that rounding alone cannot make them meet.
        max_visible_difference: Grey difference below which a point counts as visible in a view.
        min_hidden_difference: Grey difference above which a point counts as hidden in a view. The
            gap to ``max_visible_difference`` leaves out points that blur of the disparity map has
            misplaced.
        min_collisions: Minimum number of decided collisions for a statement about the sign.
        sign_fraction: Fraction of collisions that settles the sign of disparity. Disparity edges
            that are too wide vote for the wrong sign: real 3x3 crops reach only 0.35 for the
            correct sign.
        disorder_ratio: Ratio of two mean grey differences above which views are in serpentine
            order, or the centre view is not in its place. Such views differ by factors of 2 to 4.
        max_moved_fraction: Fraction of misplaced views above which serpentine order and a misplaced
            centre view are tested.
        min_textured_fraction: Fraction of textured pixels below which views that are equally
            consistent in all view orders may still be a light field.
        wrong_grid_fraction: Fraction of reliable pixels above which views that are equally
            consistent in all view orders are not a light field, if the scene has a disparity of at
            least ``wrong_grid_disparity``.
        wrong_grid_disparity: See ``wrong_grid_fraction``, in pixels per view step.
        wrong_grid_span: Range of disparity, relative to the largest candidate, above which views
            that are equally consistent in all view orders are not a light field.
        max_misplaced_fraction: Fraction of views nearer to another place of the grid than to their
            own above which the grid or the order of the views is wrong. Wrong grids have 0.44 and
            more, positions with errors of 0.3 view steps (standard deviation) about 0.1.
        brightness: Settings of the measurement of brightness.
        registration: Settings of the measurement of view spacing, shifts and camera positions.
    """

    view_steps: tuple[int, ...] = (1, 2, 4)
    nearest_views: int = 8
    coarse_size_px: int = 96
    fine_size_px: int = 256
    brightness_percentile: float = 98.0
    high_pass_radius_px: int = 4
    max_motion: float = 0.2
    max_disparity: float = 0.08
    max_wide_disparity: float = 0.4
    max_wide_candidates: int = 129
    min_fraction_beyond: float = 0.005
    max_disparity_px: float | None = None
    max_candidates: int = 65
    candidate_motion_px: float = 0.5
    cost_radii_px: tuple[int, ...] = (3, 2, 1)
    noise_floor: float = 0.05 / 255
    clearly_worse_ratio: float = 1.15
    alike_ratio: float = 1.05
    window_radii_px: tuple[int, ...] = (0, 3, 8)
    clear_minimum: float = 0.5
    significance: float = 5.0
    max_noise_fraction: float = 0.05
    min_group_fraction: float = 0.002
    range_percentiles: tuple[float, float] = (0.05, 99.95)
    sufficient_fraction: float = 0.6
    range_step: float = 0.05
    unknown_range: tuple[float, float] = (-4.0, 4.0)
    min_collision_px: float = 1.5
    max_visible_difference: float = 0.04
    min_hidden_difference: float = 0.08
    min_collisions: int = 50
    sign_fraction: float = 0.8
    disorder_ratio: float = 1.4
    max_moved_fraction: float = 0.2
    min_textured_fraction: float = 0.1
    wrong_grid_fraction: float = 0.85
    wrong_grid_disparity: float = 0.3
    wrong_grid_span: float = 1.6
    max_misplaced_fraction: float = 0.3
    brightness: BrightnessConfig = BrightnessConfig()
    registration: RegistrationConfig = RegistrationConfig()
