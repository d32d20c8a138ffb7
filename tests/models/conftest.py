"""Small networks with non-trivial weights and statistics, shared by the tests of this folder."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.models import preset
from tests.reference.variables import random_variables


@pytest.fixture(scope="session")
def tiny_views():
    """Two light fields, ``[2, 3, 3, 12, 14]``."""
    return jax.random.uniform(jax.random.key(1), (2, 3, 3, 12, 14))


@pytest.fixture(scope="session")
def tiny_variables():
    """Variables of the preset ``tiny``."""
    return random_variables(preset("tiny"))


@pytest.fixture(scope="session")
def uniform():
    """Function that returns uniform random numbers of a given shape."""

    def draw(*shape, seed=0):
        return jnp.asarray(np.random.default_rng(seed).random(shape, np.float32))

    return draw
