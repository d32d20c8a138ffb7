"""The small network, its random variables, and random proposals."""

import jax.numpy as jnp
import numpy as np
import pytest

from occjax.models import preset
from occjax.models.proposal.proposals import ProposalCosts, Proposals
from tests.reference.variables import random_variables


@pytest.fixture(scope="session")
def variables():
    """Random variables of the preset ``proposal_small``."""
    return random_variables(preset("proposal_small"))


@pytest.fixture(scope="session")
def random_proposals():
    """Function that returns random proposals of a given size, as if of 8 neighbours."""

    def draw(h, w):
        generator = np.random.default_rng(0)
        centre, disparity, variance, peak = generator.random((4, h, w), np.float32)
        proposed = disparity + generator.normal(0, 0.3, (10, h, w)).astype(np.float32)
        proposed[0] = disparity
        costs = ProposalCosts(jnp.asarray(generator.random((10, 13, h, w)), jnp.float16))
        arrays = map(jnp.asarray, (centre, disparity, proposed))
        return Proposals(*arrays, costs, jnp.asarray(variance), jnp.asarray(peak))

    return draw
