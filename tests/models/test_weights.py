"""Weights on disk, with their configuration, and files of earlier versions."""

import dataclasses
import json

import jax
import numpy as np
import pytest
from flax import traverse_util
from safetensors.numpy import save_file

from occjax.errors import InputError
from occjax.estimators import make_estimator
from occjax.models import ProposalNetConfig, load_weights, preset, save_weights
from occjax.models.config_json import config_from_json, config_to_json
from occjax.models.proposal import (
    CostConfig,
    ProposalsConfig,
    RefinementConfig,
    SearchConfig,
    SelectorConfig,
)
from occjax.models.registry import preset_name
from tests.reference.variables import random_variables

KERNEL = "params/aggregation_0/score/kernel"


@pytest.fixture
def saved(tmp_path, tiny_variables):
    path = tmp_path / "tiny.safetensors"
    save_weights(path, tiny_variables, preset("tiny"), {"trained_on": "nothing"})
    return path


def assert_equal(variables, expected):
    assert jax.tree.structure(variables) == jax.tree.structure(expected)
    jax.tree.map(np.testing.assert_array_equal, variables, expected)


@pytest.mark.parametrize("name", ["tiny", "proposal_small"])
def test_weights_and_configuration_are_restored(name, tmp_path):
    variables = random_variables(preset(name))
    save_weights(tmp_path / "weights.safetensors", variables, preset(name))
    restored, config = load_weights(tmp_path / "weights.safetensors")
    assert config == preset(name)
    assert_equal(restored, variables)


@pytest.mark.parametrize("name", ["proposal", "photometric", "occcasnet", "cas_2_occ_gt"])
def test_configurations_are_restored_from_json(name):
    assert config_from_json(config_to_json(preset(name))) == preset(name)


LEGACY_STAGE = {
    "kind": "StageConfig",
    "occlusion": "none",
    "attention": True,
    "semi_global": None,
    "plane_steps": 0,
    "neighbours": [],
    "second": 0.7,
    "window": None,
}
LEGACY_NETWORK = {
    "kind": "NetworkConfig",
    "shared_aggregation": False,
    "warp": "correct",
    "feature_statistics": "pooled",
    "reach": 4.0,
}
"""Fields of all stages and networks, as version 0.1 wrote them."""


def write_legacy(path, description, variables, rename=lambda name: name):
    flat = traverse_util.flatten_dict(variables, sep="/")
    tensors = {rename(name): np.asarray(value) for name, value in flat.items()}
    save_file(tensors, path, metadata={"config": json.dumps(description), "step": "2500"})


def test_proposal_weights_of_version_0_1_are_loaded(tmp_path):
    offsets = ((0, -3), (0, 3), (-3, 0), (3, 0))
    expected = ProposalNetConfig(
        costs=CostConfig(grey_truncation=0.03, derivative_truncation=0.005),
        search=SearchConfig(2, 0.5, 1.0, 0.25, 0.9, 0.04, 0.2),
        refinement=RefinementConfig(steps=2),
        proposals=ProposalsConfig(offsets=offsets, min_second_distance=0.6),
        selector=SelectorConfig(width=4, context=(4, 6), window=0.2),
    )
    semi_global = {"smoothness": 0.25, "jump": 0.9, "edge": 0.04, "temperature": 0.2}
    search = LEGACY_STAGE | {
        "candidates": [-1.0, -0.5, 0.0, 0.5, 1.0],
        "volume": "sectors",
        "aggregation": None,
        "attention": False,
        "semi_global": {"kind": "SemiGlobalConfig", **semi_global},
    }
    choice = LEGACY_STAGE | {
        "candidates": [],
        "volume": "sectors",
        "aggregation": {"kind": "Choice", "width": 4, "context": [4, 6]},
        "occlusion": "coarse",
        "attention": False,
        "plane_steps": 2,
        "neighbours": [list(offset) for offset in offsets],
        "second": 0.6,
        "window": 0.2,
    }
    truncations = {"grey_truncation": 0.03, "derivative_truncation": 0.005}
    description = LEGACY_NETWORK | {
        "stages": [search, choice],
        "views": None,
        "features": {"kind": "DerivativeFeatures", **truncations},
        "attention_width": 120,
    }
    variables = random_variables(expected)
    write_legacy(
        tmp_path / "light.safetensors",
        description,
        variables,
        lambda name: name.replace("params/selector/", "params/sectors/choice/"),
    )
    restored, config = load_weights(tmp_path / "light.safetensors")
    assert config == expected
    assert_equal(restored, variables)


@pytest.mark.parametrize("stored", [{"kind": "WeightedMedianConfig", "radius_px": 2}, None])
def test_weights_with_a_weighted_median_get_the_support_instead(tmp_path, stored):
    config = preset("proposal_small", residual=None)
    description = json.loads(config_to_json(config))
    del description["support"]
    description["weighted_median"] = stored
    write_legacy(tmp_path / "old.safetensors", description, random_variables(config))
    restored = load_weights(tmp_path / "old.safetensors")[1]
    assert restored == (config if stored else dataclasses.replace(config, support=None))


def test_occcasnet_weights_of_version_0_1_are_loaded(tmp_path, tiny_variables):
    residual = {"kind": "Residual", "width": 8, "pairs": 1}
    stages = [
        LEGACY_STAGE
        | {"candidates": candidates, "volume": "concatenate", "aggregation": residual}
        | {"occlusion": occlusion}
        for candidates, occlusion in (
            ([-2.0, -1.0, 0.0, 1.0, 2.0], "none"),
            ([-0.5, 0.0, 0.5], "coarse"),
        )
    ]
    features = json.loads(config_to_json(preset("tiny")))["features"]
    description = LEGACY_NETWORK | {
        "stages": stages,
        "views": [3, 3],
        "features": features,
        "attention_width": 8,
    }
    write_legacy(tmp_path / "tiny.safetensors", description, tiny_variables)
    restored, config = load_weights(tmp_path / "tiny.safetensors", preset("tiny"))
    assert config == preset("tiny")
    assert_equal(restored, tiny_variables)


def test_options_of_use_are_not_part_of_the_model(saved):
    assert load_weights(saved, warp="transposed")[1].warp == "transposed"
    load_weights(saved, preset("tiny", feature_statistics="per_view"))
    with pytest.raises(
        InputError, match=r"tiny.safetensors: .*another model: stages\[0\].candidates is"
    ):
        load_weights(saved, preset("occcasnet"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda flat: flat.pop(KERNEL), f"has no weight {KERNEL}"),
        (
            lambda flat: flat.update({"params/more": flat[KERNEL]}),
            "the model has no weight params/more",
        ),
        (
            lambda flat: flat.update({KERNEL: flat[KERNEL][:1]}),
            f"{KERNEL} has shape .1, 3, 3, 8, 1.",
        ),
        (
            lambda flat: flat.update({KERNEL: flat[KERNEL] * np.nan}),
            f"{KERNEL} has values that are not finite",
        ),
    ],
)
def test_variables_of_another_model_are_not_saved(tmp_path, tiny_variables, change, message):
    flat = traverse_util.flatten_dict(tiny_variables, sep="/")
    change(flat)
    path = tmp_path / "weights.safetensors"
    with pytest.raises(InputError, match=message):
        save_weights(path, traverse_util.unflatten_dict(flat, sep="/"), preset("tiny"))
    assert not path.exists()


def test_weights_need_their_suffix(tmp_path, tiny_variables):
    with pytest.raises(InputError, match=r"are written to \.safetensors"):
        save_weights(tmp_path / "weights", tiny_variables, preset("tiny"))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("cut.safetensors", b"\x10\x00", "cannot be decoded as a safetensors file"),
        ("absent.safetensors", None, "no such file"),
        ("weights.pt", b"", "not a file of weights; pass .safetensors"),
    ],
)
def test_unusable_files_are_refused(tmp_path, name, content, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=message) as error:
        load_weights(path)
    assert name in str(error.value)


def test_configuration_of_a_later_version_is_refused(tmp_path):
    path = tmp_path / "later.safetensors"
    save_file({}, path, metadata={"config": '{"kind": "ProposalNetConfig", "later": 1}'})
    with pytest.raises(
        InputError, match=r"later.safetensors: cannot be decoded as the configuration"
    ):
        load_weights(path)


def test_weights_without_a_residual_fit_the_model_of_their_name(tmp_path):
    config = preset("proposal_small", residual=None)
    save_weights(tmp_path / "earlier.safetensors", random_variables(config), config)
    _, loaded = load_weights(tmp_path / "earlier.safetensors", preset("proposal_small"))
    assert loaded == config
    assert preset_name(loaded) == "proposal_small"
    estimator = make_estimator("proposal_small", weights=tmp_path / "earlier.safetensors")
    assert estimator.name == "proposal_small"
