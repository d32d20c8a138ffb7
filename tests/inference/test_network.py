"""Inference in strips gives the answer of the whole image."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.inference.network import infer
from occjax.models import OccCasNet, Residual, StageConfig, preset, sampled
from tests.reference.variables import random_variables

CONFIG = preset("tiny", warp="transposed")  # halo of 6 pixels


@pytest.fixture(scope="module")
def case():
    views = jax.random.uniform(jax.random.key(1), (3, 3, 37, 11))
    variables = random_variables(CONFIG)
    return variables, views, jax.jit(OccCasNet(CONFIG).apply)(variables, views)


# 37 rows: strips that divide nothing, a single strip, strips thinner than the halo.
@pytest.mark.parametrize("rows", [10, 30, 3])
def test_strips_give_the_whole_image_answer(case, rows):
    variables, views, whole = case
    stripped = jax.jit(partial(infer, config=CONFIG, strip_rows=rows))(variables, views)
    for strip, full in zip(stripped, whole, strict=True):
        np.testing.assert_allclose(strip.disparity, full.disparity, atol=1e-5)
        np.testing.assert_allclose(strip.probabilities, full.probabilities, atol=1e-5)
        np.testing.assert_allclose(strip.attention, full.attention, rtol=1e-5)


def test_inference_is_differentiable_and_vmappable(case):
    variables, views, whole = case

    def mean_disparity(views):
        return infer(variables, views, CONFIG, strip_rows=20)[-1].disparity.mean()

    values, gradients = jax.jit(jax.vmap(jax.value_and_grad(mean_disparity)))(
        jnp.stack([views, views])
    )
    np.testing.assert_allclose(values, whole[-1].disparity.mean(), atol=1e-5)
    assert np.isfinite(gradients).all()
    assert np.abs(gradients).max() > 0


def test_memory_of_strips_stays_below_that_of_the_whole_volume():
    stage = StageConfig(sampled(-2.0, 2.0, 0.25), aggregation=Residual(32, 1))
    config = preset("tiny", stages=(stage,))
    variables = random_variables(config)
    views = jax.ShapeDtypeStruct((3, 3, 256, 64), jnp.float32)

    def temporary_bytes(rows):
        run = jax.jit(partial(infer, config=config, strip_rows=rows))
        return run.lower(variables, views).compile().memory_analysis().temp_size_in_bytes

    assert temporary_bytes(16) < 0.4 * temporary_bytes(256)


def test_a_grid_of_another_size_is_refused():
    with pytest.raises(InputError, match=r"takes grey views \[3, 3, H, W\]"):
        infer({}, jnp.zeros((5, 5, 8, 8)), CONFIG)
