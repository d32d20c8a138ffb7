"""Weights with their configuration in one file."""

import jax
import numpy as np
import pytest
from flax import traverse_util
from safetensors.numpy import save_file

from occjax.errors import InputError
from occjax.models import preset
from occjax.models.weights import load_weights, save_weights
from tests.reference.variables import random_variables


@pytest.fixture
def saved(tmp_path, tiny_variables):
    path = tmp_path / "tiny.safetensors"
    save_weights(path, tiny_variables, preset("tiny"), {"trained_on": "nothing"})
    return path


def test_weights_and_configuration_come_back(saved, tiny_variables):
    variables, config = load_weights(saved)
    assert config == preset("tiny")
    assert jax.tree.structure(variables) == jax.tree.structure(tiny_variables)
    jax.tree.map(np.testing.assert_array_equal, variables, tiny_variables)


def test_the_warp_can_be_chosen(saved):
    assert load_weights(saved, warp="transposed")[1].warp == "transposed"


def test_another_network_is_refused_with_the_difference(saved):
    with pytest.raises(
        InputError, match=r"tiny.safetensors: .*another network: stages\[0\].candidates is"
    ):
        load_weights(saved, preset("occcasnet"))


def test_the_choice_of_training_statistics_is_no_other_network(saved):
    load_weights(saved, preset("tiny", feature_statistics="per_view"))


def changed(change):
    def spoil(variables):
        flat = traverse_util.flatten_dict(variables, sep="/")
        change(flat)
        return traverse_util.unflatten_dict(flat, sep="/")

    return spoil


KERNEL = "params/aggregation_0/score/kernel"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda flat: flat.pop(KERNEL), f"has no weight {KERNEL}"),
        (lambda flat: flat.update({"params/more": flat[KERNEL]}), "no place for params/more"),
        (lambda flat: flat.update({KERNEL: flat[KERNEL][:1]}), f"{KERNEL} is .1, 3, 3, 8, 1."),
        (lambda flat: flat.update({KERNEL: flat[KERNEL] * np.nan}), f"{KERNEL} is not finite"),
    ],
)
def test_variables_that_are_not_the_configurations_are_refused(
    tmp_path, tiny_variables, change, message
):
    with pytest.raises(InputError, match=message):
        save_weights(tmp_path / "w.safetensors", changed(change)(tiny_variables), preset("tiny"))
    assert not (tmp_path / "w.safetensors").exists()


def test_a_configuration_of_another_version_is_refused(tmp_path):
    path = tmp_path / "later.safetensors"
    save_file({}, path, metadata={"config": '{"stages": [], "features": {}, "later": 1}'})
    with pytest.raises(InputError, match=r"later.safetensors: holds no network configuration"):
        load_weights(path)


def test_weights_need_their_suffix(tmp_path, tiny_variables):
    with pytest.raises(InputError, match=r"ends in \.safetensors"):
        save_weights(tmp_path / "weights", tiny_variables, preset("tiny"))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("cut.safetensors", b"\x10\x00", "not a readable safetensors file"),
        ("absent.safetensors", None, "no such file"),
        ("weights.pt", b"", "weights end in .safetensors"),
    ],
)
def test_unusable_files_are_named(tmp_path, name, content, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=message) as error:
        load_weights(path)
    assert name in str(error.value)


def test_networks_of_all_kinds_are_stored(tmp_path):
    for name in ("light_small", "cas_2_occ_gt"):  # with a number among the weights; with a truth
        variables = random_variables(preset(name))
        save_weights(tmp_path / "weights.safetensors", variables, preset(name))
        again, config = load_weights(tmp_path / "weights.safetensors")
        assert config == preset(name)
        jax.tree.map(np.testing.assert_array_equal, again, variables)
