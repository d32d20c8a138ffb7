import json

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.evaluation.metrics import Metrics, evaluate


@pytest.fixture
def maps():
    """Two rough maps of 37x43 whose errors spread over all the thresholds."""
    generator = np.random.default_rng(0)
    truth = generator.uniform(-2.0, 2.0, (37, 43)).astype(np.float32)
    return truth + generator.laplace(0.0, 0.05, truth.shape).astype(np.float32), truth


def looped(estimate, truth, thresholds, border, mask=None):
    """The definitions, pixel by pixel."""
    errors = []
    for y in range(border, truth.shape[0] - border):
        for x in range(border, truth.shape[1] - border):
            if mask is None or mask[y, x]:
                errors.append(abs(float(estimate[y, x]) - float(truth[y, x])))
    return {
        "mse_x100": 100.0 * sum(error**2 for error in errors) / len(errors),
        "badpix": {t: 100.0 * sum(error > t for error in errors) / len(errors) for t in thresholds},
        "q25_x100": 100.0 * sorted(errors)[len(errors) // 4],
        "pixels": len(errors),
    }


@pytest.mark.parametrize("border", [0, 3, 15])
@pytest.mark.parametrize("masked", [False, True])
def test_measures_match_their_definitions_pixel_by_pixel(maps, border, masked, tolerance):
    thresholds = (0.1, 0.02)
    mask = np.random.default_rng(1).random(maps[1].shape) < 0.6 if masked else None
    expected = looped(*maps, thresholds, border, mask)
    metrics = evaluate(*maps, thresholds=thresholds, border=border, mask=mask)
    assert metrics.pixels == expected["pixels"]
    assert metrics.missing == 0
    assert metrics.border == border
    np.testing.assert_allclose(metrics.mse_x100, expected["mse_x100"], **tolerance("float64"))
    np.testing.assert_allclose(metrics.q25_x100, expected["q25_x100"], **tolerance("float64"))
    assert metrics.badpix == pytest.approx(expected["badpix"], rel=tolerance("float64")["rtol"])


def test_error_equal_to_the_threshold_is_not_bad():
    truth = np.zeros((1, 4))
    estimate = np.array([[0.25, -0.25, 0.2500001, -0.5]])
    assert evaluate(estimate, truth, thresholds=(0.25,), border=0).badpix == {0.25: 50.0}


@pytest.mark.parametrize(("count", "entry"), [(1, 0), (3, 0), (4, 1), (7, 1), (8, 2), (9, 2)])
def test_q25_is_the_entry_at_a_quarter_of_the_count_rounded_down(count, entry):
    errors = np.random.default_rng(2).permutation(np.arange(count, dtype=float))
    assert evaluate(errors[None], np.zeros((1, count)), border=0).q25_x100 == 100.0 * entry


def test_errors_in_the_border_do_not_count():
    truth = np.zeros((32, 33))
    estimate = np.full(truth.shape, 9.0)
    estimate[15:17, 15:18] = 0.0
    metrics = evaluate(estimate, truth)
    assert (metrics.pixels, metrics.mse_x100, metrics.badpix[0.01]) == (6, 0.0, 0.0)
    assert evaluate(estimate, truth, border=14).badpix[0.01] == pytest.approx(70.0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_pixel_without_an_estimate_is_bad_and_not_in_the_means(value):
    truth = np.zeros((2, 4))
    estimate = np.array([[0.1, 0.1, 0.1, value], [0.3, 0.1, 0.1, 0.1]])
    metrics = evaluate(estimate, truth, border=0, thresholds=(0.2, 100.0))
    assert metrics.missing == 1
    assert metrics.pixels == 8
    assert metrics.badpix == {0.2: 25.0, 100.0: 12.5}
    assert metrics.mse_x100 == pytest.approx(100.0 * (6 * 0.01 + 0.09) / 7)
    assert metrics.q25_x100 == pytest.approx(10.0)
    assert "missing" in metrics.table()


def test_pixel_without_ground_truth_is_left_out():
    truth = np.array([[0.0, np.nan, np.inf, 0.0]])
    metrics = evaluate(np.array([[1.0, 5.0, 5.0, 1.0]]), truth, border=0)
    assert (metrics.pixels, metrics.missing, metrics.mse_x100) == (2, 0, 100.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"estimate": np.zeros((40, 41))},
            r"estimate is \[40, 41\] but ground truth is \[40, 40\]",
        ),
        ({"estimate": np.zeros((40, 40, 1))}, r"estimate is \[40, 40, 1\]"),
        ({"ground_truth": np.zeros((1, 40, 40))}, r"ground truth must be one disparity map"),
        ({"mask": np.ones((40, 39), bool)}, r"mask is \[40, 39\]"),
        ({"border": 20}, "no pixel inside a border of 20"),
        ({"border": -1}, "border is -1"),
        ({"thresholds": (0.07, -0.1)}, "threshold is -0.1"),
        ({"thresholds": (0.07, np.nan)}, "threshold is nan"),
        ({"thresholds": (np.inf,)}, "threshold is inf"),
        ({"thresholds": ()}, "no BadPix threshold"),
        ({"mask": np.zeros((40, 40), bool)}, "no pixel to compare"),
        ({"ground_truth": np.full((40, 40), np.nan)}, "no pixel to compare"),
        ({"estimate": np.full((40, 40), np.nan)}, "no finite value"),
    ],
)
def test_maps_that_do_not_fit_are_refused_in_one_line(arguments, message):
    maps = {"estimate": np.zeros((40, 40)), "ground_truth": np.zeros((40, 40))}
    with pytest.raises(InputError, match=message) as caught:
        evaluate(**(maps | arguments))
    assert "\n" not in str(caught.value)


def test_table_and_dictionary_show_the_numbers():
    metrics = Metrics(0.20062, {0.07: 0.262994, 0.5: 0.0}, 0.0726, 232324, 0, 15)
    lines = [line.split() for line in metrics.table().splitlines()]
    assert lines[:4] == [
        ["MSE", "x100", "0.201"],
        ["BadPix", "0.07", "0.263", "%"],
        ["BadPix", "0.5", "0.000", "%"],
        ["Q25", "x100", "0.073"],
    ]
    assert lines[4][:2] == ["pixels", "232324"]
    assert json.loads(json.dumps(metrics.as_dict(), allow_nan=False)) == {
        "mse_x100": 0.20062,
        "badpix": {"0.07": 0.262994, "0.5": 0.0},
        "q25_x100": 0.0726,
        "pixels": 232324,
        "missing": 0,
        "border": 15,
    }
