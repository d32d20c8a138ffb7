"""Small networks with weights and statistics that are not trivial, shared by the tests."""

import jax
import pytest

from occjax.models import preset
from tests.reference.variables import random_variables


@pytest.fixture(scope="session")
def tiny_views():
    """Two light fields, ``[2, 3, 3, 12, 14]``."""
    return jax.random.uniform(jax.random.key(1), (2, 3, 3, 12, 14))


@pytest.fixture(scope="session")
def tiny_variables():
    """Variables of the tiny preset."""
    return random_variables(preset("tiny"))
