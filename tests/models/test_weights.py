"""Weights with their configuration in one file."""

import jax
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.models import preset
from occjax.models.weights import load_weights, save_weights


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
    with pytest.raises(InputError, match=r"tiny.safetensors: was made for another network: stages"):
        load_weights(saved, preset("occcasnet"))


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
