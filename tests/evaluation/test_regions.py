"""Measures of regions, on scenes whose scores follow from their construction."""

import math

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.evaluation import bumpiness, fattening, missed_dots, wrong_layer

Y, X = np.mgrid[:40, :50].astype(float)
NEAR, FAR = 1.5, -0.5


def bar(left, right):
    """A vertical bar in front of a wall: disparity of columns left to right (not included)."""
    return np.where((left <= X) & (right > X), NEAR, FAR)


def wall_near_bar(left, right, width):
    """Pixels of the wall within a distance of the bar."""
    return ((left - width <= X) & (left > X)) | ((right <= X) & (right + width > X))


TRUTH = bar(22, 28)
ON = TRUTH == NEAR
FATTENING, THINNING = {"wrong": ON, "right": ~ON}, {"wrong": ~ON, "right": ON}


def thinning(estimate, truth, **options):
    return fattening(-estimate, -truth, **options)


@pytest.mark.parametrize("plane", [np.zeros_like(X), 0.7 + 0.01 * X - 0.02 * Y])
def test_offset_and_tilt_are_not_bumpy(plane):
    rough_scene = np.sin(X) * np.cos(0.3 * Y)
    assert bumpiness(rough_scene + plane, rough_scene) == pytest.approx(0.0, abs=1e-14)


def test_bumpiness_of_a_quadric_is_the_norm_of_its_hessian(tolerance):
    # f = a x^2 / 2 + b x y + c y^2 / 2 has the Hessian [[a, b], [b, c]] everywhere.
    a, b, c = 0.01, -0.007, 0.004
    error = 0.5 * a * X**2 + b * X * Y + 0.5 * c * Y**2
    expected = math.sqrt(a**2 + 2 * b**2 + c**2)
    np.testing.assert_allclose(bumpiness(X + error, X), expected, **tolerance("float64"))
    np.testing.assert_allclose(bumpiness(X - error, X), expected, **tolerance("float64"))


def test_bumpiness_is_limited_and_measured_in_the_region():
    truth = np.zeros_like(X)
    estimate = truth.copy()
    estimate[20, 25] = 9.0  # bends its eight neighbours and itself
    region = np.zeros(truth.shape, bool)
    region[18:24, 20:30] = True
    assert bumpiness(estimate, truth, mask=region) == pytest.approx(0.05 * 9 / 60)
    assert bumpiness(estimate, truth, mask=~region) == 0.0


def test_bumpiness_matches_its_definition_pixel_by_pixel(tolerance):
    generator = np.random.default_rng(0)
    truth = generator.normal(size=(9, 11))
    error = 0.01 * generator.normal(size=truth.shape)
    total, f = 0.0, error
    for y in range(1, 8):
        for x in range(1, 10):
            xx = f[y, x + 1] - 2 * f[y, x] + f[y, x - 1]
            yy = f[y + 1, x] - 2 * f[y, x] + f[y - 1, x]
            xy = (f[y + 1, x + 1] - f[y + 1, x - 1] - f[y - 1, x + 1] + f[y - 1, x - 1]) / 4
            total += min(0.05, math.sqrt(xx**2 + xy**2 + xy**2 + yy**2))
    np.testing.assert_allclose(
        bumpiness(truth + error, truth, border=1), total / (7 * 9), **tolerance("float64")
    )


def test_missing_estimate_has_the_largest_bumpiness_and_missing_truth_does_not_count():
    truth = np.zeros((9, 9))
    estimate = truth.copy()
    estimate[4, 4] = np.nan
    assert bumpiness(estimate, truth, border=0) == pytest.approx(0.05 * 9 / 81)
    assert bumpiness(truth, estimate, border=0) == 0.0


def test_bar_that_is_one_pixel_too_wide_on_each_side():
    estimate = bar(21, 29)
    around = wall_near_bar(22, 28, 4)  # four columns on each side, one of them covered
    assert fattening(estimate, TRUTH, mask=around) == pytest.approx(25.0)
    assert thinning(estimate, TRUTH, mask=ON) == 0.0
    assert wrong_layer(estimate, TRUTH, **FATTENING, mask=around) == pytest.approx(25.0)
    assert wrong_layer(estimate, TRUTH, **THINNING, mask=ON) == 0.0


def test_bar_that_is_one_pixel_too_thin_on_one_side():
    estimate = bar(23, 28)
    assert thinning(estimate, TRUTH, mask=ON) == pytest.approx(100 / 6)
    assert fattening(estimate, TRUTH, mask=~ON) == 0.0
    assert wrong_layer(estimate, TRUTH, **THINNING, mask=ON) == pytest.approx(100 / 6)
    assert wrong_layer(estimate, TRUTH, **FATTENING, mask=~ON) == 0.0


@pytest.mark.parametrize(
    ("error", "fat", "thin"), [(0.149, 0, 0), (0.151, 100, 0), (-0.151, 0, 100)]
)
def test_threshold_at_fine_structures_is_015(error, fat, thin):
    assert fattening(TRUTH + error, TRUTH) == fat
    assert thinning(TRUTH + error, TRUTH) == thin


@pytest.mark.parametrize(("fraction", "fat"), [(0.49, 0.0), (0.51, 100.0)])
def test_layers_are_separated_halfway_between_tilted_surfaces(fraction, fat):
    near, far = 1.0 + 0.01 * Y, -1.0 - 0.01 * Y  # constant along rows, so extrapolated exactly
    truth = np.where(ON, near, far)
    around = wall_near_bar(22, 28, 6)
    estimate = np.where(around, far + fraction * (near - far), truth)
    assert wrong_layer(estimate, truth, **FATTENING, mask=around) == fat
    assert wrong_layer(estimate, truth, **THINNING, mask=around) == 100.0 - fat


def test_exactly_halfway_is_closer_to_neither_layer():
    halfway = np.full_like(TRUTH, 0.5 * (NEAR + FAR))
    assert wrong_layer(halfway, TRUTH, **FATTENING) == 0.0
    assert wrong_layer(halfway, TRUTH, **THINNING) == 0.0


def test_pixel_without_an_estimate_counts_in_every_measure():
    estimate = np.full_like(TRUTH, np.nan)
    assert fattening(estimate, TRUTH) == thinning(estimate, TRUTH) == 100.0
    assert wrong_layer(estimate, TRUTH, **FATTENING) == 100.0
    assert wrong_layer(estimate, TRUTH, **THINNING) == 100.0


def test_dot_is_missed_if_more_than_half_of_it_is_bad():
    truth = np.zeros_like(X)
    dots = np.zeros(truth.shape, bool)
    estimate = truth.copy()
    for number, bad in enumerate([0, 8, 9, 16]):  # of 16 pixels each
        rows, columns = slice(18, 22), slice(16 + 5 * number, 20 + 5 * number)
        dots[rows, columns] = True
        estimate[rows, columns] = np.where(np.arange(16) < bad, 0.41, 0.0).reshape(4, 4)
    assert missed_dots(estimate, truth, dots) == 50.0
    assert missed_dots(0.97 * estimate, truth, dots) == 0.0  # 0.398 is still detected


def test_winding_dot_is_one_dot_and_dots_in_the_border_do_not_count():
    spiral = np.array(
        [
            [1, 1, 1, 1, 1],
            [0, 0, 0, 0, 1],
            [1, 1, 1, 0, 1],
            [1, 0, 0, 0, 1],
            [0, 1, 1, 1, 0],  # connected at corners only
        ],
        bool,
    )
    dots = np.zeros((12, 12), bool)
    dots[1:6, 1:6] = spiral
    dots[8, 8] = dots[0, 11] = True
    estimate, truth = np.where(dots, 9.0, 0.0), np.zeros(dots.shape)
    estimate[8, 8] = 0.0
    assert missed_dots(estimate, truth, dots, border=1) == 50.0
    assert missed_dots(estimate, truth, dots, border=0) == pytest.approx(100 * 2 / 3)


@pytest.mark.parametrize("measure", [bumpiness, fattening])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"estimate": np.zeros((40, 41))}, r"estimate is \[40, 41\]"),
        ({"mask": np.zeros((40, 40), bool)}, "no pixel to compare"),
        ({"border": 20}, "no pixel inside a border of 20"),
    ],
)
def test_maps_that_do_not_fit_are_refused(measure, arguments, message):
    maps = {"estimate": np.zeros((40, 40)), "ground_truth": np.zeros((40, 40))}
    with pytest.raises(InputError, match=message):
        measure(**(maps | arguments))


def test_layers_without_a_pixel_are_refused():
    with pytest.raises(InputError, match="a layer has no pixel"):
        wrong_layer(TRUTH, TRUTH, wrong=np.zeros_like(ON), right=~ON)
