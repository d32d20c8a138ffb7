"""Estimators with random weights, shared by the tests of this folder."""

import pytest

from occjax.estimators import make_estimator
from occjax.models import preset, save_weights
from tests.reference.variables import random_variables
from tests.scenes import plane


@pytest.fixture(scope="session")
def weights_file(tmp_path_factory):
    """Function that writes random weights of a preset and returns the path of the file."""

    def write(name):
        path = tmp_path_factory.mktemp("weights") / f"{name}.safetensors"
        save_weights(path, random_variables(preset(name)), preset(name))
        return path

    return write


@pytest.fixture(scope="session")
def estimators(weights_file):
    """One estimator of each kind, by name."""
    return {
        "photometric": make_estimator("photometric"),
        "tiny": make_estimator(weights=weights_file("tiny")),
        "proposal_small": make_estimator(weights=weights_file("proposal_small")),
    }


@pytest.fixture(scope="session")
def scene():
    """A slanted plane, 3x3 views of 24x32 pixels."""
    return plane(size=(24, 32), slope=(0.01, -0.005))
