"""Measures of regions, on scenes whose scores follow from how they are made."""

import math

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.evaluation import (
    bumpiness,
    fattening,
    foreground_fattening,
    foreground_thinning,
    missed_dots,
    thinning,
)

Y, X = np.mgrid[:40, :50].astype(float)
NEAR, FAR = 1.5, -0.5


def bar(left, right):
    """A vertical bar in front of a wall: disparity of columns left to right (not included)."""
    return np.where((left <= X) & (right > X), NEAR, FAR)


def wall_beside(left, right, width):
    """Pixels of the wall within a distance of the bar."""
    return ((left - width <= X) & (left > X)) | ((right <= X) & (right + width > X))


@pytest.mark.parametrize("plane", [np.zeros_like(X), 0.7 + 0.01 * X - 0.02 * Y])
def test_an_offset_and_a_tilt_are_not_bumpy(plane):
    rough_scene = np.sin(X) * np.cos(0.3 * Y)
    assert bumpiness(rough_scene + plane, rough_scene) == pytest.approx(0.0, abs=1e-14)


def test_bumpiness_of_a_quadric_is_the_norm_of_its_hessian():
    # f = a x^2 / 2 + b x y + c y^2 / 2 has the Hessian [[a, b], [b, c]] everywhere.
    a, b, c = 0.01, -0.007, 0.004
    error = 0.5 * a * X**2 + b * X * Y + 0.5 * c * Y**2
    expected = math.sqrt(a**2 + 2 * b**2 + c**2)
    assert bumpiness(X + error, X) == pytest.approx(expected, rel=1e-9)
    assert bumpiness(X - error, X) == pytest.approx(expected, rel=1e-9)


def test_bumpiness_is_bounded_and_only_of_the_region():
    truth = np.zeros_like(X)
    estimate = truth.copy()
    estimate[20, 25] = 9.0  # bends its eight neighbours and itself
    region = np.zeros(truth.shape, bool)
    region[18:24, 20:30] = True
    assert bumpiness(estimate, truth, mask=region) == pytest.approx(0.05 * 9 / 60)
    assert bumpiness(estimate, truth, mask=~region) == 0.0


def test_bumpiness_follows_its_definition_pixel_by_pixel():
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
    assert bumpiness(truth + error, truth, border=1) == pytest.approx(total / (7 * 9), rel=1e-9)


def test_a_missing_estimate_is_as_rough_as_can_be_and_missing_truth_does_not_count():
    truth = np.zeros((9, 9))
    estimate = truth.copy()
    estimate[4, 4] = np.nan
    assert bumpiness(estimate, truth, border=0) == pytest.approx(0.05 * 9 / 81)
    unknown = truth.copy()
    unknown[4, 4] = np.nan
    assert bumpiness(truth, unknown, border=0) == 0.0


def test_a_bar_that_is_one_pixel_too_wide_on_each_side():
    truth, estimate = bar(22, 28), bar(21, 29)
    around = wall_beside(22, 28, 4)  # four columns on each side, one of them covered
    assert fattening(estimate, truth, mask=around) == pytest.approx(25.0)
    assert thinning(estimate, truth, mask=truth == NEAR) == 0.0
    layers = {"foreground": truth == NEAR, "background": truth == FAR}
    assert foreground_fattening(estimate, truth, **layers, mask=around) == pytest.approx(25.0)
    assert foreground_thinning(estimate, truth, **layers, mask=truth == NEAR) == 0.0


def test_a_bar_that_is_one_pixel_too_thin_on_one_side():
    truth, estimate = bar(22, 28), bar(23, 28)
    on = truth == NEAR
    assert thinning(estimate, truth, mask=on) == pytest.approx(100 / 6)
    assert fattening(estimate, truth, mask=~on) == 0.0
    layers = {"foreground": on, "background": ~on}
    assert foreground_thinning(estimate, truth, **layers, mask=on) == pytest.approx(100 / 6)
    assert foreground_fattening(estimate, truth, **layers, mask=~on) == 0.0


@pytest.mark.parametrize(
    ("error", "fat", "thin"), [(0.149, 0, 0), (0.151, 100, 0), (-0.151, 0, 100)]
)
def test_fine_structures_are_judged_by_an_error_of_015(error, fat, thin):
    truth = bar(22, 28)
    assert fattening(truth + error, truth) == fat
    assert thinning(truth + error, truth) == thin


@pytest.mark.parametrize(("share", "fat"), [(0.49, 0.0), (0.51, 100.0)])
def test_layers_are_told_apart_halfway_even_where_both_are_tilted(share, fat):
    on = (X >= 22) & (X < 28)
    near, far = 1.0 + 0.01 * Y, -1.0 - 0.01 * Y  # each constant along a row, so continued exactly
    truth = np.where(on, near, far)
    beside = wall_beside(22, 28, 6)
    estimate = np.where(beside, far + share * (near - far), truth)
    layers = {"foreground": on, "background": ~on}
    assert foreground_fattening(estimate, truth, **layers, mask=beside) == fat
    assert foreground_thinning(estimate, truth, **layers, mask=beside) == 100.0 - fat


def test_a_pixel_without_an_estimate_is_fat_and_thin():
    truth = bar(22, 28)
    estimate = np.full_like(truth, np.nan)
    layers = {"foreground": truth == NEAR, "background": truth == FAR}
    for measure in (fattening, thinning):
        assert measure(estimate, truth) == 100.0
    for measure in (foreground_fattening, foreground_thinning):
        assert measure(estimate, truth, **layers) == 100.0


def test_a_dot_is_missed_if_more_than_half_of_it_is_bad():
    truth = np.zeros_like(X)
    dots = np.zeros(truth.shape, bool)
    estimate = truth.copy()
    for number, bad in enumerate([0, 8, 9, 16]):  # of 16 pixels each
        rows = slice(18, 22)
        columns = slice(16 + 5 * number, 20 + 5 * number)
        dots[rows, columns] = True
        block = np.zeros(16)
        block[:bad] = 0.41
        estimate[rows, columns] = block.reshape(4, 4)
    assert missed_dots(estimate, truth, dots) == 50.0
    assert missed_dots(0.97 * estimate, truth, dots) == 0.0  # 0.398 is still detected


def test_dots_that_wind_are_one_and_those_in_the_border_do_not_count():
    truth = np.zeros((12, 12))
    spiral = np.array(
        [
            [1, 1, 1, 1, 1],
            [0, 0, 0, 0, 1],
            [1, 1, 1, 0, 1],
            [1, 0, 0, 0, 1],
            [0, 1, 1, 1, 0],  # joined at corners only
        ],
        bool,
    )
    dots = np.zeros(truth.shape, bool)
    dots[1:6, 1:6] = spiral
    dots[8, 8] = True
    dots[0, 11] = True
    estimate = np.where(dots, 9.0, 0.0)
    estimate[8, 8] = 0.0
    assert missed_dots(estimate, truth, dots, border=1) == 50.0
    assert missed_dots(estimate, truth, dots, border=0) == pytest.approx(100 * 2 / 3)


@pytest.mark.parametrize("measure", [bumpiness, fattening, thinning])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"estimate": np.zeros((40, 41))}, r"estimate is \[40, 41\]"),
        ({"mask": np.zeros((40, 40), bool)}, "no pixel to compare"),
        ({"mask": np.ones((40, 39), bool)}, r"mask is \[40, 39\]"),
        ({"border": 20}, "nothing inside a border of 20"),
    ],
)
def test_what_cannot_be_compared_is_refused(measure, arguments, message):
    maps = {"estimate": np.zeros((40, 40)), "ground_truth": np.zeros((40, 40))}
    with pytest.raises(InputError, match=message):
        measure(**(maps | arguments))


def test_layers_without_a_foreground_are_refused():
    truth = bar(22, 28)
    with pytest.raises(InputError, match="no foreground"):
        foreground_fattening(
            truth, truth, foreground=np.zeros(truth.shape, bool), background=truth == FAR
        )


def test_exactly_halfway_is_closer_to_neither_layer():
    truth = bar(22, 28)
    halfway = np.full_like(truth, 0.5 * (NEAR + FAR))
    layers = {"foreground": truth == NEAR, "background": truth == FAR}
    assert foreground_fattening(halfway, truth, **layers) == 0.0
    assert foreground_thinning(halfway, truth, **layers) == 0.0
