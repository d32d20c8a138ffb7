"""Random variables and proposals, drawn by NumPy: compiling ``init`` takes longer."""

import jax
import jax.numpy as jnp
import numpy as np

from occjax.models import ModelConfig, variable_shapes
from occjax.models.proposal.proposals import ProposalCosts, Proposals


def random_variables(config: ModelConfig, seed: int = 0) -> dict:
    """Draw kernels scaled by their fan-in, scales and variances near one, the rest near zero."""
    generator = np.random.default_rng(seed)

    def draw(path, leaf):
        noise = generator.normal(size=leaf.shape)
        name = path[-1].key
        if name == "kernel":
            value = noise * np.sqrt(2 / np.prod(leaf.shape[:-1]))
        else:
            value = 0.2 * np.abs(noise) + 0.9 if name in ("scale", "var") else 0.2 * noise
        return jnp.asarray(value, leaf.dtype)

    return jax.tree_util.tree_map_with_path(draw, variable_shapes(config))


def random_proposals(h, w):
    """Return random proposals of a given size, as if of 8 neighbours."""
    generator = np.random.default_rng(0)
    centre, disparity, variance, peak = generator.random((4, h, w), np.float32)
    proposed = disparity + generator.normal(0, 0.3, (10, h, w)).astype(np.float32)
    proposed[0] = disparity
    costs = ProposalCosts(jnp.asarray(generator.random((10, 13, h, w)), jnp.float16))
    arrays = map(jnp.asarray, (centre, disparity, proposed))
    return Proposals(*arrays, costs, jnp.asarray(variance), jnp.asarray(peak))
