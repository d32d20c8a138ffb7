"""Published weights layout and published activations, also those of the fixture in this folder."""

import dataclasses
import functools

import h5py
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.models import AggregationConfig, OccCasNet, preset
from occjax.models.occcasnet.keras_weights import load_published_weights
from occjax.models.weights import load_weights
from occjax.ops import occlusion_weights
from tests.reference.make_fixture import LIMITS, load_fixture
from tests.reference.published_layout import write_published_layout


@functools.partial(jax.jit, static_argnames="config")
def intermediate_results(variables, views, config):
    network = OccCasNet(config)
    coarse, refined = network.apply(variables, views)
    features = network.apply(variables, views, method="extract")
    v, u = config.views
    octant = jnp.triu_indices(v // 2 + 1)

    def volume(index, stage, before):
        candidates, maps = stage.candidates, stage.occlusion
        return network.apply(variables, index, features, candidates, before, maps, method="volume")

    return {
        "feature_center": features[v // 2, u // 2],
        "attention_coarse": coarse.attention[octant],
        "attention_refined": refined.attention[octant],
        "occlusion_weight": occlusion_weights(refined.occlusion),
        "coarse_volume_sample": volume(0, coarse, None)[::8, ::7, ::5],
        "refined_volume_sample": volume(1, refined, coarse.disparity)[::2, ::7, ::5],
        "coarse_prob": coarse.probabilities.transpose(1, 2, 0),
        "refined_prob": refined.probabilities.transpose(1, 2, 0),
        "disparity_coarse": coarse.disparity,
        "disparity_refined": refined.disparity,
    }


def assert_agree(ours, theirs):
    for name, tolerance in LIMITS.items():
        assert ours[name].shape == theirs[name].shape, name
        error = np.abs(np.asarray(ours[name], np.float64) - theirs[name])
        assert error.max() <= tolerance, f"{name}: {error.max():.1e}"
    for name in ("disparity_coarse", "disparity_refined"):
        assert np.abs(np.asarray(ours[name]) - theirs[name]).mean() <= 5e-5, name


@pytest.mark.slow
@pytest.mark.parametrize("warp", ["correct", "transposed"])
def test_network_reproduces_published_activations(shared, warp):
    variables, config = load_weights(shared / "parity/official_layout_weights.h5", warp=warp)
    with np.load(shared / f"parity/{warp}_warp.npz") as published:
        results = intermediate_results(variables, jnp.asarray(published["light_field"]), config)
        assert_agree(results, published)


@pytest.fixture(scope="module")
def fixture():
    return load_fixture()


def small_config(fixture, **changes):
    _, arrays = fixture
    coarse, refined = preset("occcasnet").stages
    candidates = [
        tuple(map(float, arrays[name])) for name in ("coarse_candidates", "refined_candidates")
    ]
    stages = tuple(
        dataclasses.replace(stage, candidates=values, aggregation=AggregationConfig(width=8))
        for stage, values in zip((coarse, refined), candidates, strict=True)
    )
    return preset("occcasnet", stages=stages, **changes)


# Keras continues its numbering when a program builds a second network.
@pytest.mark.parametrize(
    ("warp", "first_number"),
    [("correct", 0), pytest.param("transposed", 7, marks=pytest.mark.slow)],
)
def test_network_agrees_with_independent_implementation(fixture, tmp_path, warp, first_number):
    weights, arrays = fixture
    path = tmp_path / "weights.hdf5"
    write_published_layout(path, weights, first_number=first_number)
    config = small_config(fixture, warp=warp)
    variables = load_published_weights(path, config)
    results = intermediate_results(variables, jnp.asarray(arrays["light_field"]), config)
    prefix = f"{warp}/"
    assert_agree(
        results, {k.removeprefix(prefix): a for k, a in arrays.items() if k.startswith(prefix)}
    )


FIRST_SCORE, SECOND_SCORE = ("conv3d_9/conv3d_9", "conv3d_19/conv3d_19")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda weights: weights.pop(f"{SECOND_SCORE}/kernel:0"),
            "no conv3d weight for aggregation_1/score",
        ),
        (
            lambda weights: weights.update({f"{FIRST_SCORE}/kernel:0": np.zeros((2, 3, 3, 8, 1))}),
            r"conv3d_9/kernel: has shape \[2, 3, 3, 8, 1\]",
        ),
        (
            lambda weights: weights.update(
                {f"{FIRST_SCORE}/kernel:0": np.full((3, 3, 3, 8, 1), np.nan)}
            ),
            "conv3d_9/kernel: has values that are not finite",
        ),
        (
            lambda weights: weights.update({f"{FIRST_SCORE}/bias:0": np.zeros(1)}),
            "no weight like conv3d_9/bias",
        ),
        (
            lambda weights: weights.update({"conv3d_20/conv3d_20/kernel:0": np.zeros(1)}),
            "no weight like conv3d_20/kernel",
        ),
        (
            lambda weights: weights.update({"dense_4/dense_4/kernel:0": np.zeros(1)}),
            "no weight like dense_4/kernel:0",
        ),
    ],
)
def test_first_weight_that_does_not_fit_is_named(fixture, tmp_path, change, message):
    path, weights = tmp_path / "weights.h5", dict(fixture[0])
    change(weights)
    write_published_layout(path, weights)
    with pytest.raises(InputError, match=message) as error:
        load_published_weights(path, small_config(fixture))
    assert str(error.value).startswith(f"{path}: ")


def test_other_files_are_refused(tmp_path):
    text = tmp_path / "text.h5"
    text.write_text("no HDF5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["data"] = [1.0]
    for path, message in [
        (text, "cannot be decoded as an HDF5 file of weights"),
        (tmp_path / "other.h5", "not a Keras 2 weights file"),
        (tmp_path / "absent.h5", "no such file"),
    ]:
        with pytest.raises(InputError, match=message):
            load_weights(path)


def test_published_layout_defaults_to_the_transposed_warp(fixture, tmp_path):
    path = tmp_path / "weights.h5"
    write_published_layout(path, fixture[0])
    assert load_weights(path, small_config(fixture))[1].warp == "transposed"
    assert load_weights(path, small_config(fixture), warp="correct")[1].warp == "correct"
