"""Inference in strips gives the answer of the whole image."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.inference.network import infer, rows_of_strip
from occjax.models import OccCasNet, Residual, StageConfig, preset, sampled, variable_shapes
from occjax.models.weights import load_weights
from tests.reference.variables import random_variables

CONFIG = preset("tiny", warp="transposed")  # halo of 6 pixels


@pytest.fixture(scope="module")
def case():
    views = jax.random.uniform(jax.random.key(1), (3, 3, 37, 11))
    variables = random_variables(CONFIG)
    return variables, views, jax.jit(OccCasNet(CONFIG).apply)(variables, views)


# 37 rows: strips that divide nothing, a single strip, strips thinner than the halo.
@pytest.mark.usefixtures("platform")
@pytest.mark.parametrize("rows", [10, 30, 3])
def test_strips_give_the_whole_image_answer(case, rows):
    variables, views, whole = case
    stripped = jax.jit(partial(infer, config=CONFIG, strip_rows=rows))(variables, views)
    for strip, full in zip(stripped, whole, strict=True):
        # Three times the rounding error of a direct convolution, see minimal_filtering.
        np.testing.assert_allclose(strip.disparity, full.disparity, atol=3e-5)
        np.testing.assert_allclose(strip.probabilities, full.probabilities, atol=3e-5)
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


@pytest.mark.parametrize(("size", "gigabytes"), [(64, 0.6), (128, 1.5), (512, 3.6)])
def test_the_published_network_stays_within_its_memory(size, gigabytes):
    """By XLA's analysis; a process may peak at 1.5, 3 and 6 GB with what it has besides."""
    config = preset("occcasnet")
    views = jax.ShapeDtypeStruct((9, 9, size, size), jnp.float32)
    run = jax.jit(lambda variables, views: infer(variables, views, config)[-1].disparity)
    compiled = run.lower(variable_shapes(config), views).compile()
    assert compiled.memory_analysis().temp_size_in_bytes < gigabytes * 1e9


def test_the_light_network_stays_within_its_memory():
    """By XLA's analysis; a process may peak at 1.5 GB with what it has besides."""
    config = preset("light")
    views, offsets = (
        jax.ShapeDtypeStruct((1, 17, *rest), jnp.float32) for rest in [(512, 512), (2,)]
    )

    def run(variables, views, offsets):
        return infer(variables, views, config, offsets=offsets)[-1].disparity

    compiled = jax.jit(run).lower(variable_shapes(config), views, offsets).compile()
    assert compiled.memory_analysis().temp_size_in_bytes < 0.75e9


@pytest.mark.parametrize(
    ("height", "width", "rows"),
    [
        (64, 64, 64),  # one strip
        (96, 512, 96),
        (97, 512, 49),  # 96 rows are read, 80 kept: two strips
        (512, 512, 74),  # seven of 90 rows
        (100, 10**6, 1),
    ],
)
def test_strips_are_even_and_no_larger_than_wanted(height, width, rows):
    assert rows_of_strip(height, width, halo=8) == rows


def test_a_grid_of_another_size_is_refused():
    with pytest.raises(InputError, match=r"takes grey views \[3, 3, H, W\]"):
        infer({}, jnp.zeros((5, 5, 8, 8)), CONFIG)


@pytest.mark.parametrize("factor", [1.0, 2.5])
def test_other_candidates_also_those_that_differ_by_more(factor):
    """A strip reads whatever rows of the views its candidates ask for, configured or not."""
    (stage, _), views = CONFIG.stages, jax.random.uniform(jax.random.key(2), (3, 3, 41, 9))
    config = preset("tiny", stages=(stage,))
    variables = random_variables(config)
    candidates = factor * jnp.asarray(stage.candidates) + 0.7
    run = jax.jit(partial(infer, config=config, strip_rows=5))
    stripped = run(variables, views, candidates=candidates)[0]
    whole = jax.jit(OccCasNet(config).apply)(variables, views, candidates=candidates)[0]
    np.testing.assert_allclose(stripped.disparity, whole.disparity, atol=1e-5)


@pytest.mark.parametrize("grid", [(2, 4), (5, 1)])
def test_grids_without_attention(grid):
    stage = StageConfig((-1.5, -0.25, 0.5), aggregation=Residual(4, 0), attention=False)
    config = preset("tiny", stages=(stage,), views=grid)
    variables = random_variables(config)
    views = jax.random.uniform(jax.random.key(3), (*grid, 19, 6))
    stripped = jax.jit(partial(infer, config=config, strip_rows=4))(variables, views)[0]
    whole = jax.jit(OccCasNet(config).apply)(variables, views)[0]
    np.testing.assert_allclose(stripped.disparity, whole.disparity, atol=1e-5)


def test_on_a_gpu_what_fits_is_computed_whole_and_the_rest_in_larger_strips(monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert rows_of_strip(256, 256, halo=8) == 256
    assert rows_of_strip(512, 512, halo=8) == 103  # five strips
    assert rows_of_strip(512, 512, 8, jnp.bfloat16) == 171  # three
    with jax.default_device(jax.devices("cpu")[0]):
        assert rows_of_strip(256, 256, halo=8) < 256
    config = preset("cas_2")

    def program(height, **options):
        views = jax.ShapeDtypeStruct((9, 9, height, 16), jnp.float32)
        run = jax.jit(partial(infer, config=config, **options))
        lowered = run.trace(variable_shapes(config), views).lower(lowering_platforms=("cuda",))
        return lowered.as_text()

    # The views are registered at once, and once only: no loop over candidates or rows of views.
    assert "stablehlo.while" not in program(20)
    assert "9x20x16x324x" in program(20)
    strips = program(60, strip_rows=20)
    assert "stablehlo.while" in strips
    assert "9x60x16x324x" not in strips


def test_the_published_network_on_reference_data(shared):
    variables, config = load_weights(shared / "parity/official_layout_weights.h5", warp="correct")
    with np.load(shared / "parity/correct_warp.npz") as published:
        views, expected = jnp.asarray(published["light_field"]), published["disparity_refined"]
    run = jax.jit(partial(infer, config=config, strip_rows=8))
    error = np.abs(run(variables, views)[-1].disparity - expected)
    assert error.max() < 1e-3  # as OccCasNet.apply, see test_published
    assert np.median(error) < 1e-5


def test_strips_of_volumes_of_statistics():
    config = CONFIG.with_stages(attention=False, volume="statistics")
    views = jax.random.uniform(jax.random.key(1), (3, 3, 37, 11))
    variables = random_variables(config)
    whole = jax.jit(OccCasNet(config).apply)(variables, views)
    stripped = jax.jit(partial(infer, config=config, strip_rows=10))(variables, views)
    for strip, full in zip(stripped, whole, strict=True):
        np.testing.assert_allclose(strip.disparity, full.disparity, atol=1e-5)
