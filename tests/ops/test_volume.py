import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from occjax.errors import InputError
from tests.ops.derivatives import assert_derivatives
from tests.reference import ops as reference

SHAPE = (3, 3, 4, 5, 2)
CANDIDATES = np.array([-1.3, 0.0, 0.45], np.float32)

COMBINES = {
    "concatenate": (ops.concatenate, reference.concatenate),
    "mean_and_variance": (ops.mean_and_variance, reference.mean_and_variance),
    "group_correlation": (ops.group_correlation(2), reference.group_correlation(2)),
}
combines = pytest.mark.parametrize("combine", COMBINES)

OPTIONS = ("combine", "streamed")
coarse_volume = jax.jit(ops.coarse_volume, static_argnames=OPTIONS)
refined_volume = jax.jit(ops.refined_volume, static_argnames=(*OPTIONS, "border"))


def random(*shape, seed=0, low=-1.0, high=1.0):
    return np.random.default_rng(seed).uniform(low, high, shape).astype(np.float32)


FEATURES = random(*SHAPE)
WEIGHTS = random(*SHAPE[:4], seed=1, low=0.1)
DISPARITY = random(*SHAPE[2:4], seed=2, low=-2.0, high=2.0)
OFFSETS = reference.view_offsets(3, 3).astype(np.float32) + random(3, 3, 2, seed=3, high=0.2, low=0)
"""Irregular camera positions: no offset is whole, not even that of the centre view."""


@combines
def test_combine_matches_the_loop(combine, tolerance):
    function, loop = COMBINES[combine]
    features, weights = jnp.asarray(FEATURES), jnp.asarray(WEIGHTS)
    with_weights = jax.jit(function)(features, weights)
    np.testing.assert_allclose(with_weights, loop(FEATURES, WEIGHTS), **tolerance("float32"))
    without = jax.jit(function)(features, None)
    np.testing.assert_allclose(without, loop(FEATURES), **tolerance("float32"))


@combines
def test_coarse_volume_matches_the_loop(combine, tolerance):
    function, loop = COMBINES[combine]
    options = {"weights": WEIGHTS, "offsets": OFFSETS}
    actual = coarse_volume(FEATURES, CANDIDATES, combine=function, **options)
    expected = reference.coarse_volume(FEATURES, CANDIDATES, combine=loop, **options)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


def test_streamed_concatenation_matches_the_loop(tolerance):
    """It goes row of views by row of views; also with shifts that leave the image, either way."""
    candidates = np.array([-9.0, -1.3, 0.0, 0.45, 2.0, 1e6], np.float32)
    actual = coarse_volume(FEATURES, candidates, offsets=OFFSETS, streamed=True)
    expected = reference.coarse_volume(
        FEATURES, candidates, combine=reference.concatenate, offsets=OFFSETS
    )
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


@pytest.mark.parametrize("grid", [(3, 3), (1, 4), (5, 2)])
def test_means_of_the_coarse_volume_are_those_of_the_loop(grid, tolerance):
    features = random(*grid, 4, 5, 2)
    candidates = np.array([-9.0, -1.3, 0.0, 0.45, 2.0, 1e6], np.float32)
    offsets = reference.view_offsets(*grid).astype(np.float32) + 0.3
    for given in (None, offsets):
        actual = jax.jit(ops.coarse_volume_means)(features, candidates, offsets=given)
        volume = reference.coarse_volume(
            features, candidates, combine=reference.concatenate, offsets=given
        )
        np.testing.assert_allclose(actual, volume.mean((0, 1, 2)), **tolerance("float32"))


@combines
@pytest.mark.parametrize("border", ["replicate", "zero"])
def test_refined_volume_matches_the_loop(combine, border, tolerance):
    function, loop = COMBINES[combine]
    options = {"weights": WEIGHTS, "offsets": OFFSETS, "border": border}
    actual = refined_volume(FEATURES, DISPARITY, CANDIDATES, combine=function, **options)
    expected = reference.refined_volume(FEATURES, DISPARITY, CANDIDATES, combine=loop, **options)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


@pytest.mark.parametrize("grid", [(1, 1), (1, 4), (3, 1), (2, 4)])
def test_volumes_of_any_regular_grid_match_the_loop(grid, tolerance):
    """One row or column of views, and even grids, whose centre is below and right of the middle."""
    features = random(*grid, *SHAPE[2:], seed=4)
    actual = coarse_volume(features, CANDIDATES)
    expected = reference.coarse_volume(features, CANDIDATES)
    assert actual.shape == (3, 4, 5, grid[0] * grid[1] * 2)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))
    actual = refined_volume(features, DISPARITY, CANDIDATES)
    expected = reference.refined_volume(features, DISPARITY, CANDIDATES)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


def test_warped_views_match_the_loop(tolerance):
    warp_views = jax.jit(ops.warp_views, static_argnames="border")
    actual = warp_views(FEATURES, DISPARITY)
    expected = reference.warp_views(FEATURES, DISPARITY)
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))
    actual = warp_views(FEATURES, DISPARITY, offsets=OFFSETS, border="zero")
    expected = reference.warp_views(FEATURES, DISPARITY, offsets=OFFSETS, border="zero")
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


def test_concatenated_channels_are_view_major():
    """Channel 4 * (9 v + u) + c of the published network."""
    v, u, h, w, c = 9, 9, 1, 1, 4
    features = jnp.arange(v * u * c, dtype=jnp.float32).reshape(v, u, h, w, c)
    np.testing.assert_array_equal(ops.concatenate(features)[0, 0], np.arange(324))


@combines
@pytest.mark.parametrize("sampling", ["coarse", "refined"])
def test_streamed_and_materialised_are_the_same(sampling, combine, tolerance):
    options = {"combine": COMBINES[combine][0], "weights": WEIGHTS, "offsets": OFFSETS}
    if sampling == "coarse":
        materialised = coarse_volume(FEATURES, CANDIDATES, **options)
        streamed = coarse_volume(FEATURES, CANDIDATES, streamed=True, **options)
    else:
        options["border"] = "replicate"
        materialised = refined_volume(FEATURES, DISPARITY, CANDIDATES, **options)
        streamed = refined_volume(FEATURES, DISPARITY, CANDIDATES, streamed=True, **options)
    np.testing.assert_allclose(streamed, materialised, **tolerance("float32"))


def test_streaming_needs_memory_for_one_candidate_only():
    """By the compiler's own account, for planes much smaller than the registered views."""
    features = jax.ShapeDtypeStruct((3, 3, 32, 32, 4), jnp.float32)
    candidates = jax.ShapeDtypeStruct((16,), jnp.float32)
    plane_of_views = 3 * 3 * 32 * 32 * 4 * 4

    def temporary(streamed):
        lowered = coarse_volume.lower(
            features, candidates, combine=ops.mean_and_variance, streamed=streamed
        )
        return lowered.compile().memory_analysis().temp_size_in_bytes

    assert temporary(False) > 16 * plane_of_views
    assert temporary(True) < 8 * plane_of_views


def test_strips_of_rows_are_the_rows_of_the_whole(tolerance):
    @jax.jit
    def strips(features, disparity, weights, first):
        """Two rows from a traced first one."""
        coarse = ops.coarse_volume(features, candidates, weights=weights, rows=(first, 2))
        refined = ops.refined_volume(
            features, disparity, candidates, weights=weights, first_row=first
        )
        return coarse, refined

    candidates = jnp.asarray(CANDIDATES)
    coarse = coarse_volume(FEATURES, CANDIDATES, weights=WEIGHTS)
    refined = refined_volume(FEATURES, DISPARITY, CANDIDATES, weights=WEIGHTS)
    streamed = jax.jit(
        lambda first: ops.coarse_volume(
            jnp.asarray(FEATURES), candidates, rows=(first, 2), streamed=True
        )
    )
    unweighted = coarse_volume(FEATURES, CANDIDATES)
    for first in range(3):
        rows = slice(first, first + 2)
        np.testing.assert_allclose(streamed(first), unweighted[:, rows], **tolerance("float32"))
        strip = strips(FEATURES, DISPARITY[rows], WEIGHTS[:, :, rows], first)
        np.testing.assert_allclose(strip[0], coarse[:, rows], **tolerance("float32"))
        np.testing.assert_allclose(strip[1], refined[:, rows], **tolerance("float32"))


def test_combine_may_be_the_users_own(tolerance):
    """Here a cost: mean absolute difference to the centre view, one channel."""

    def cost(views, weights):
        centre = views[1, 1][None, None]
        return jnp.abs(views - centre).mean((0, 1, 4))[..., None]

    volume = coarse_volume(FEATURES, CANDIDATES, combine=cost)
    views = [
        reference.warp_views(FEATURES, np.full(SHAPE[2:4], candidate), border="zero")
        for candidate in CANDIDATES
    ]
    expected = [np.abs(each - each[1, 1]).mean((0, 1, 4))[..., None] for each in views]
    assert volume.shape == (3, 4, 5, 1)
    np.testing.assert_allclose(volume, expected, **tolerance("float32"))


def test_candidates_are_data_not_part_of_the_compiled_program(tolerance):
    traces = []

    @jax.jit
    def volumes(features, disparity, candidates):
        traces.append(candidates)
        coarse = ops.coarse_volume(features, candidates)
        return coarse, ops.refined_volume(features, disparity, candidates)

    for candidates in (CANDIDATES, CANDIDATES[::-1] * np.float32(0.7)):
        coarse, refined = volumes(FEATURES, DISPARITY, candidates)
        expected = reference.coarse_volume(FEATURES, candidates)
        np.testing.assert_allclose(coarse, expected, **tolerance("float32"))
        expected = reference.refined_volume(FEATURES, DISPARITY, candidates)
        np.testing.assert_allclose(refined, expected, **tolerance("float32"))
    assert len(traces) == 1


def test_vmap_is_a_loop_over_light_fields(tolerance):
    features = np.stack([FEATURES, FEATURES[::-1]])
    disparities = np.stack([DISPARITY, -DISPARITY])
    batched = jax.jit(jax.vmap(ops.refined_volume, in_axes=(0, 0, None)))
    volumes = batched(features, disparities, CANDIDATES)
    coarse = jax.jit(jax.vmap(ops.coarse_volume, in_axes=(0, None)))(features, CANDIDATES)
    for k in range(2):
        one = refined_volume(features[k], disparities[k], CANDIDATES)
        np.testing.assert_allclose(volumes[k], one, **tolerance("float32"))
        one = coarse_volume(features[k], CANDIDATES)
        np.testing.assert_allclose(coarse[k], one, **tolerance("float32"))


@pytest.mark.parametrize("dtype", ["bfloat16", "float64"])
def test_every_dtype_is_kept_and_matches_the_loop(dtype, tolerance):
    """On the default grid, whose offsets are float32 whatever the rest."""
    with jax.enable_x64(dtype == "float64"):
        arrays = [jnp.asarray(a, dtype) for a in (FEATURES, DISPARITY, CANDIDATES, WEIGHTS)]
        features, disparity, candidates, weights = arrays
        loops = [np.asarray(a, np.float64) for a in arrays]
        coarse = coarse_volume(features, candidates, weights=weights)
        refined = refined_volume(
            features, disparity, candidates, weights=weights, combine=ops.mean_and_variance
        )
        correlation = jax.jit(ops.group_correlation(2))(features, weights)
        expected = (
            reference.coarse_volume(loops[0], loops[2], weights=loops[3]),
            reference.refined_volume(
                *loops[:3], weights=loops[3], combine=reference.mean_and_variance
            ),
            reference.group_correlation(2)(loops[0], loops[3]),
        )
        for actual, loop in zip((coarse, refined, correlation), expected, strict=True):
            assert actual.dtype == dtype
            np.testing.assert_allclose(np.float64(actual), loop, **tolerance(dtype))


def test_a_disparity_in_full_precision_goes_with_the_rest_in_half(tolerance):
    """The candidates too: their sum with the disparity is not rounded to half precision."""
    features, candidates = (jnp.asarray(a, jnp.bfloat16) for a in (FEATURES, CANDIDATES))
    loops = np.asarray(features, np.float64), DISPARITY, np.asarray(candidates, np.float64)
    volume = refined_volume(features, DISPARITY, candidates, weights=WEIGHTS)
    expected = reference.refined_volume(*loops, weights=WEIGHTS)
    assert volume.dtype == jnp.bfloat16
    np.testing.assert_allclose(np.float64(volume), expected, **tolerance("bfloat16"))


def test_a_view_of_no_weight_changes_no_statistic(tolerance):
    """The occluded view may show anything; the others agree, so their variance is zero."""
    views = np.broadcast_to(FEATURES[1, 1], SHAPE).copy()
    views[0, 2] = 1e3
    weights = np.ones(SHAPE[:4], np.float32)
    weights[0, 2] = 0.0
    statistics = jax.jit(ops.mean_and_variance)(views, weights)
    np.testing.assert_allclose(statistics[..., :2], FEATURES[1, 1], **tolerance("float32"))
    np.testing.assert_allclose(statistics[..., 2:], 0.0, **tolerance("float32"))
    correlation = jax.jit(ops.group_correlation(1))(views, weights)
    expected = np.square(FEATURES[1, 1]).mean(-1, keepdims=True)
    np.testing.assert_allclose(correlation, expected, **tolerance("float32"))


@combines
def test_no_weight_at_all_gives_zero_and_no_nan_in_any_gradient(combine):
    function = COMBINES[combine][0]
    weights = np.zeros(SHAPE[:4], np.float32)
    weights[:, :, 0] = 1.0  # the other rows of pixels have none

    def total(features, weights):
        volume = function(features, weights)
        return jnp.sin(volume).sum(), volume

    gradients, volume = jax.jit(jax.grad(total, argnums=(0, 1), has_aux=True))(FEATURES, weights)
    assert not np.any(volume[1:])
    assert np.any(volume[0])
    assert all(np.all(np.isfinite(gradient)) for gradient in gradients)


def test_scaling_all_weights_changes_no_statistic(tolerance):
    statistics = jax.jit(ops.mean_and_variance)
    expected = statistics(FEATURES, WEIGHTS)
    scaled = statistics(FEATURES, 1e-12 * WEIGHTS)
    np.testing.assert_allclose(scaled, expected, **tolerance("float32"))


def test_equal_weights_are_as_none(tolerance):
    for combine in ("mean_and_variance", "group_correlation"):
        function = COMBINES[combine][0]
        weighted = jax.jit(function)(FEATURES, np.full(SHAPE[:4], 0.3, np.float32))
        plain = jax.jit(function)(FEATURES, None)
        np.testing.assert_allclose(weighted, plain, **tolerance("float32"))


def test_groups_that_do_not_divide_the_channels_are_an_error():
    with pytest.raises(InputError, match="2 are no multiple of 3"):
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

    @combines
    def test_refined_volume(self, combine):
        def function(features, disparity, candidates, weights, offsets):
            return ops.refined_volume(
                features,
                disparity,
                candidates,
                weights=weights,
                offsets=offsets,
                combine=COMBINES[combine][0],
            )

        candidates = CANDIDATES[[0, 2]]
        assert_derivatives(function, FEATURES, DISPARITY, candidates, WEIGHTS, OFFSETS)

    def test_streamed_refined_volume_with_zero_border(self):
        def function(features, disparity, candidates):
            return ops.refined_volume(
                features,
                disparity,
                candidates,
                combine=ops.mean_and_variance,
                border="zero",
                streamed=True,
            )

        assert_derivatives(function, FEATURES, DISPARITY, CANDIDATES[[0, 2]])
