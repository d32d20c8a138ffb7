"""The small network, its random variables, and random proposals."""

import pytest

from occjax.models import preset
from tests.reference.variables import random_proposals as draw, random_variables


@pytest.fixture(scope="session")
def variables():
    """Random variables of the preset ``proposal_small``."""
    return random_variables(preset("proposal_small"))


@pytest.fixture(scope="session")
def random_proposals():
    """Function that returns random proposals of a given size, as if of 8 neighbours."""
    return draw
