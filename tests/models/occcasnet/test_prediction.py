"""Prediction in strips equals the whole image and needs less memory."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.models import (
    AggregationConfig,
    OccCasNet,
    StageConfig,
    evenly_spaced,
    predict,
    preset,
    variable_shapes,
)
from occjax.models.occcasnet.prediction import rows_of_strip
from occjax.models.weights import load_weights
from tests.reference.variables import random_variables
from tests.training.conftest import NETWORK

CONFIG = preset("tiny", warp="transposed")  # halo of 6 pixels


def in_strips(rows, config=CONFIG):
    return jax.jit(partial(predict, config=config, strip_rows=rows))


@pytest.fixture(scope="module")
def case(tiny_variables, uniform):
    """Variables, views of 37 rows and the output for the whole image."""
    views = uniform(3, 3, 37, 11)
    return tiny_variables, views, jax.jit(OccCasNet(CONFIG).apply)(tiny_variables, views)


# 37 rows: strips of unequal content, a single strip, strips thinner than the halo.
@pytest.mark.usefixtures("platform")
@pytest.mark.parametrize(
    "rows", [10, pytest.param(30, marks=pytest.mark.slow), pytest.param(3, marks=pytest.mark.slow)]
)
def test_strips_equal_the_whole_image(case, rows):
    variables, views, whole = case
    stripped = in_strips(rows)(variables, views)
    for strip, full in zip(stripped, whole, strict=True):
        # Three times the rounding error of a direct convolution, see minimal_filtering.
        np.testing.assert_allclose(strip.disparity, full.disparity, atol=3e-5)
        np.testing.assert_allclose(strip.probabilities, full.probabilities, atol=3e-5)
        np.testing.assert_allclose(strip.attention, full.attention, rtol=1e-5)


FAST = preset("tiny", warp="transposed", features=NETWORK.features)
"""Fewer layers of features: all networks but one differ in their stages."""

STATISTICS = FAST.with_stages(attention=False, volume="statistics")
ROW_OR_COLUMN = StageConfig(
    (-1.5, -0.25, 0.5), aggregation=AggregationConfig(4, 0), attention=False
)


@pytest.mark.parametrize(
    ("config", "shape", "candidates"),
    [
        (STATISTICS, (3, 3, 37, 11), None),
        (dataclasses.replace(FAST, stages=(ROW_OR_COLUMN,), views=(2, 4)), (2, 4, 19, 6), None),
        pytest.param(
            dataclasses.replace(FAST, stages=(ROW_OR_COLUMN,), views=(5, 1)),
            (5, 1, 19, 6),
            None,
            marks=pytest.mark.slow,
        ),
        # A strip reads all rows that its candidates need, also those farther away than configured.
        (
            dataclasses.replace(FAST, stages=CONFIG.stages[:1]),
            (3, 3, 41, 9),
            (-4.3, -1.8, 0.7, 3.2, 5.7),
        ),
    ],
    ids=["statistics", "two rows", "a column", "other candidates"],
)
def test_strips_equal_the_whole_image_for_other_networks(
    config, shape, candidates, uniform, tolerance
):
    variables, views = random_variables(config), uniform(*shape)
    candidates = None if candidates is None else jnp.array(candidates)
    stripped = in_strips(5, config)(variables, views, candidates=candidates)
    whole = jax.jit(OccCasNet(config).apply)(variables, views, candidates=candidates)
    for strip, full in zip(stripped, whole, strict=True):
        np.testing.assert_allclose(strip.disparity, full.disparity, **tolerance("convolution"))


@pytest.mark.slow
def test_prediction_is_differentiable_and_vmappable(uniform, tolerance):
    config = dataclasses.replace(FAST, stages=(ROW_OR_COLUMN,))
    variables, views = random_variables(config), uniform(3, 3, 9, 6)

    def mean_disparity(views, rows=6):
        return predict(variables, views, config, strip_rows=rows)[-1].disparity.mean()

    values, gradients = jax.jit(jax.vmap(jax.value_and_grad(mean_disparity)))(
        jnp.stack([views, views])
    )
    whole = jax.jit(partial(mean_disparity, rows=9))(views)
    np.testing.assert_allclose(values, whole, **tolerance("convolution"))
    assert np.isfinite(gradients).all()
    assert np.abs(gradients).max() > 0


def temporary_bytes(run, *arguments):
    """Memory of the compiled program besides its arguments and results, by XLA's analysis."""
    analysis = jax.jit(run).lower(*arguments).compile().memory_analysis()
    return analysis.temp_size_in_bytes


@pytest.mark.slow
def test_strips_need_less_memory_than_the_whole_volume():
    stage = StageConfig(evenly_spaced(-2.0, 2.0, 0.25), aggregation=AggregationConfig(32, 1))
    config = dataclasses.replace(FAST, stages=(stage,))
    arguments = variable_shapes(config), jax.ShapeDtypeStruct((3, 3, 256, 64), jnp.float32)
    strips, whole = (
        temporary_bytes(partial(predict, config=config, strip_rows=rows), *arguments)
        for rows in (16, 256)
    )
    assert strips < 0.4 * whole


@pytest.mark.slow
@pytest.mark.parametrize(("size", "gigabytes"), [(64, 0.6), (512, 3.6)])
def test_published_network_stays_within_its_memory(size, gigabytes):
    config = preset("occcasnet")
    views = jax.ShapeDtypeStruct((9, 9, size, size), jnp.float32)

    def run(variables, views):
        return predict(variables, views, config)[-1].disparity

    assert temporary_bytes(run, variable_shapes(config), views) < gigabytes * 1e9


@pytest.mark.parametrize(
    ("height", "width", "rows"),
    [
        (64, 64, 64),  # one strip
        (96, 512, 96),
        (97, 512, 49),  # 96 rows are read, 80 kept: two strips
        (512, 512, 74),  # seven strips that read 90 rows
        (100, 10**6, 1),
    ],
)
def test_strips_are_even_and_limited(height, width, rows):
    assert rows_of_strip(height, width, halo=8) == rows


def test_strips_on_a_gpu_are_larger_or_the_whole_image(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert rows_of_strip(256, 256, halo=8) == 256
    assert rows_of_strip(512, 512, halo=8) == 103  # five strips
    assert rows_of_strip(512, 512, 8, jnp.bfloat16) == 171  # three strips
    with jax.default_device(jax.devices("cpu")[0]):
        assert rows_of_strip(256, 256, halo=8) < 256


@pytest.mark.slow
def test_published_activations_in_strips(shared):
    variables, config = load_weights(shared / "parity/official_layout_weights.h5", warp="correct")
    with np.load(shared / "parity/correct_warp.npz") as published:
        views, expected = jnp.asarray(published["light_field"]), published["disparity_refined"]
    error = np.abs(in_strips(24, config)(variables, views)[-1].disparity - expected)
    assert error.max() < 1e-3  # the limit of test_keras_weights
    assert np.median(error) < 1e-5


def test_other_grid_and_empty_strips_are_refused():
    with pytest.raises(InputError, match=r"takes grey views \[3, 3, H, W\]"):
        predict({}, jnp.zeros((5, 5, 8, 8)), CONFIG)
    with pytest.raises(InputError, match="strip_rows must be positive"):
        predict({}, jnp.zeros((3, 3, 8, 8)), CONFIG, strip_rows=0)
