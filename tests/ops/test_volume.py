"""Cost volumes against NumPy loops, their options, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from occjax.errors import InputError
from tests.ops.arrays import random
from tests.ops.derivatives import assert_derivatives
from tests.reference import ops as reference

SHAPE = (3, 3, 4, 5, 2)
CANDIDATES = np.array([-1.3, 0.0, 0.45], np.float32)
FAR_CANDIDATES = np.array([-9.0, -1.3, 0.0, 0.45, 2.0, 1e6], np.float32)
"""Also shifts that leave the image on either side."""

COMBINES = {
    "concatenate": (ops.concatenate, reference.concatenate),
    "mean_and_variance": (ops.mean_and_variance, reference.mean_and_variance),
    "group_correlation": (ops.group_correlation(2), reference.group_correlation(2)),
}
combines = pytest.mark.parametrize("combine", COMBINES)

OPTIONS = ("combine", "streamed")
coarse_volume = jax.jit(ops.coarse_volume, static_argnames=OPTIONS)
refined_volume = jax.jit(ops.refined_volume, static_argnames=(*OPTIONS, "border"))

FEATURES = random(*SHAPE)
WEIGHTS = random(*SHAPE[:4], seed=1, low=0.1)
DISPARITY = random(*SHAPE[2:4], seed=2, low=-2.0, high=2.0)
OFFSETS = reference.view_offsets(3, 3).astype(np.float32) + random(3, 3, 2, seed=3, high=0.2, low=0)
"""Irregular camera positions: no offset is whole, not even that of the centre view."""


@combines
@pytest.mark.parametrize("weights", [None, WEIGHTS], ids=["no weights", "weights"])
def test_combine_matches_loop(combine, weights, tolerance):
    function, loop = COMBINES[combine]
    actual = jax.jit(function)(FEATURES, weights)
    np.testing.assert_allclose(actual, loop(FEATURES, weights), **tolerance("float32"))


@combines
@pytest.mark.parametrize("streamed", [False, True])
def test_coarse_volume_matches_loop(combine, streamed, tolerance):
    function, loop = COMBINES[combine]
    options = {"weights": WEIGHTS, "offsets": OFFSETS}
    actual = coarse_volume(FEATURES, CANDIDATES, combine=function, streamed=streamed, **options)
    expected = reference.coarse_volume(FEATURES, CANDIDATES, combine=loop, **options)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


def test_streamed_concatenation_without_weights_matches_loop(tolerance):
    actual = coarse_volume(FEATURES, FAR_CANDIDATES, offsets=OFFSETS, streamed=True)
    expected = reference.coarse_volume(FEATURES, FAR_CANDIDATES, offsets=OFFSETS)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


@pytest.mark.parametrize("grid", [(3, 3), (1, 4), (5, 2)])
def test_means_of_the_coarse_volume_match_loop(grid, tolerance):
    features = random(*grid, 4, 5, 2)
    for offsets in (None, reference.view_offsets(*grid).astype(np.float32) + 0.3):
        actual = jax.jit(ops.coarse_volume_means)(features, FAR_CANDIDATES, offsets=offsets)
        volume = reference.coarse_volume(features, FAR_CANDIDATES, offsets=offsets)
        np.testing.assert_allclose(actual, volume.mean((0, 1, 2)), **tolerance("float32"))


@combines
@pytest.mark.parametrize(("border", "streamed"), [("replicate", True), ("zero", False)])
def test_refined_volume_matches_loop(combine, border, streamed, tolerance):
    function, loop = COMBINES[combine]
    options = {"weights": WEIGHTS, "offsets": OFFSETS, "border": border}
    actual = refined_volume(
        FEATURES, DISPARITY, CANDIDATES, combine=function, streamed=streamed, **options
    )
    expected = reference.refined_volume(FEATURES, DISPARITY, CANDIDATES, combine=loop, **options)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


@pytest.mark.parametrize("grid", [(1, 1), (1, 4), (3, 1), (2, 4)])
def test_volumes_of_any_regular_grid_match_loop(grid, tolerance):
    """One row or column of views, and even grids: the centre is below and right of the middle."""
    features = random(*grid, *SHAPE[2:], seed=4)
    actual = coarse_volume(features, CANDIDATES)
    expected = reference.coarse_volume(features, CANDIDATES)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))
    actual = refined_volume(features, DISPARITY, CANDIDATES)
    expected = reference.refined_volume(features, DISPARITY, CANDIDATES)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


@pytest.mark.parametrize("options", [{}, {"offsets": OFFSETS, "border": "zero"}])
def test_warped_views_match_loop(options, tolerance):
    actual = jax.jit(ops.warp_views, static_argnames="border")(FEATURES, DISPARITY, **options)
    expected = reference.warp_views(FEATURES, DISPARITY, **options)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


def test_concatenated_channels_are_view_major():
    """Channel 4 * (9 v + u) + c of the published network."""
    v, u, h, w, c = 9, 9, 1, 1, 4
    features = jnp.arange(v * u * c, dtype=jnp.float32).reshape(v, u, h, w, c)
    np.testing.assert_array_equal(ops.concatenate(features)[0, 0], np.arange(324))


def test_streaming_needs_memory_for_one_candidate():
    """According to the compiler, for planes much smaller than the registered views."""
    features = jax.ShapeDtypeStruct((3, 3, 32, 32, 4), jnp.float32)
    candidates = jax.ShapeDtypeStruct((16,), jnp.float32)
    registered_views = 3 * 3 * 32 * 32 * 4 * 4

    def temporary_bytes(streamed):
        lowered = coarse_volume.lower(
            features, candidates, combine=ops.mean_and_variance, streamed=streamed
        )
        return lowered.compile().memory_analysis().temp_size_in_bytes

    assert temporary_bytes(False) > 16 * registered_views
    assert temporary_bytes(True) < 8 * registered_views


def test_strips_are_rows_of_the_whole(tolerance):
    @jax.jit
    def strips(features, disparity, weights, first):
        """Two rows from a traced first one."""
        coarse = ops.coarse_volume(features, candidates, weights=weights, rows=(first, 2))
        streamed = ops.coarse_volume(features, candidates, rows=(first, 2), streamed=True)
        refined = ops.refined_volume(
            features, disparity, candidates, weights=weights, first_row=first
        )
        return coarse, streamed, refined

    candidates = jnp.asarray(CANDIDATES)
    whole = (
        coarse_volume(FEATURES, CANDIDATES, weights=WEIGHTS),
        coarse_volume(FEATURES, CANDIDATES),
        refined_volume(FEATURES, DISPARITY, CANDIDATES, weights=WEIGHTS),
    )
    for first in range(3):
        rows = slice(first, first + 2)
        found = strips(FEATURES, DISPARITY[rows], WEIGHTS[:, :, rows], first)
        for strip, volume in zip(found, whole, strict=True):
            np.testing.assert_allclose(strip, volume[:, rows], **tolerance("float32"))


def test_combine_may_be_any_function(tolerance):
    """Here a cost: mean absolute difference to the centre view, one channel."""

    def cost(views, weights):
        return jnp.abs(views - views[1, 1][None, None]).mean((0, 1, 4))[..., None]

    volume = coarse_volume(FEATURES, CANDIDATES, combine=cost)
    expected = reference.coarse_volume(
        FEATURES, CANDIDATES, combine=lambda v, _: np.abs(v - v[1, 1]).mean((0, 1, 4))[..., None]
    )
    np.testing.assert_allclose(volume, expected, **tolerance("float32"))


@pytest.mark.parametrize("dtype", ["bfloat16", "float64"])
def test_dtype_is_kept_and_matches_loop(dtype, tolerance):
    """On the default grid, whose offsets are float32 whatever the type of the rest."""
    with jax.enable_x64(dtype == "float64"):
        arrays = [jnp.asarray(a, dtype) for a in (FEATURES, DISPARITY, CANDIDATES, WEIGHTS)]
        features, disparity, candidates, weights = arrays
        loops = [np.asarray(a, np.float64) for a in arrays]
        statistics, loop_statistics = COMBINES["mean_and_variance"]
        actual = (
            coarse_volume(features, candidates, weights=weights),
            refined_volume(features, disparity, candidates, weights=weights, combine=statistics),
            jax.jit(ops.group_correlation(2))(features, weights),
        )
        expected = (
            reference.coarse_volume(loops[0], loops[2], weights=loops[3]),
            reference.refined_volume(*loops[:3], weights=loops[3], combine=loop_statistics),
            reference.group_correlation(2)(loops[0], loops[3]),
        )
        for found, loop in zip(actual, expected, strict=True):
            assert found.dtype == dtype
            np.testing.assert_allclose(np.float64(found), loop, **tolerance(dtype))


def test_candidates_plus_disparity_are_not_rounded_to_half_precision(tolerance):
    features, candidates = (jnp.asarray(a, jnp.bfloat16) for a in (FEATURES, CANDIDATES))
    loops = np.asarray(features, np.float64), DISPARITY, np.asarray(candidates, np.float64)
    volume = refined_volume(features, DISPARITY, candidates, weights=WEIGHTS)
    expected = reference.refined_volume(*loops, weights=WEIGHTS)
    assert volume.dtype == jnp.bfloat16
    np.testing.assert_allclose(np.float64(volume), expected, **tolerance("bfloat16"))


@combines
def test_zero_weights_give_zero_and_finite_gradients(combine):
    function = COMBINES[combine][0]
    weights = np.zeros(SHAPE[:4], np.float32)
    weights[:, :, 0] = 1.0  # all weights of the other rows of pixels are zero

    def total(features, weights):
        volume = function(features, weights)
        return jnp.sin(volume).sum(), volume

    gradients, volume = jax.jit(jax.grad(total, argnums=(0, 1), has_aux=True))(FEATURES, weights)
    assert not np.any(volume[1:])
    assert np.any(volume[0])
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)


@pytest.mark.parametrize("combine", ["mean_and_variance", "group_correlation"])
def test_scale_of_the_weights_changes_no_statistic(combine, tolerance):
    statistics = jax.jit(COMBINES[combine][0])
    expected = statistics(FEATURES, WEIGHTS)
    scaled = statistics(FEATURES, np.float32(1e-12) * WEIGHTS)
    np.testing.assert_allclose(scaled, expected, **tolerance("float32"))


def test_groups_that_do_not_divide_the_channels_are_refused():
    with pytest.raises(InputError, match="must divide the 2 channels; 3 does not"):
        ops.group_correlation(3)(jnp.asarray(FEATURES), None)
    with pytest.raises(InputError, match="groups must be at least 1, not 0"):
        ops.group_correlation(0)


@pytest.mark.usefixtures("x64")
class TestDerivatives:
    @combines
    def test_coarse_volume(self, combine):
        def function(features, candidates, weights, offsets):
            return ops.coarse_volume(
                features, candidates, weights=weights, offsets=offsets, combine=COMBINES[combine][0]
            )

        assert_derivatives(function, FEATURES, CANDIDATES[[0, 2]], WEIGHTS, OFFSETS)

    @pytest.mark.parametrize(
        ("combine", "options"),
        [
            ("concatenate", {}),
            ("mean_and_variance", {"border": "zero", "streamed": True}),
            ("group_correlation", {}),
        ],
    )
    def test_refined_volume(self, combine, options):
        def function(features, disparity, candidates, weights, offsets):
            return ops.refined_volume(
                features,
                disparity,
                candidates,
                weights=weights,
                offsets=offsets,
                combine=COMBINES[combine][0],
                **options,
            )

        candidates = CANDIDATES[[0, 2]]
        assert_derivatives(function, FEATURES, DISPARITY, candidates, WEIGHTS, OFFSETS)
