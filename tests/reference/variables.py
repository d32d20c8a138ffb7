"""Random variables of a model, drawn by NumPy: compiling ``init`` takes longer than most tests."""

import jax
import jax.numpy as jnp
import numpy as np

from occjax.models import ModelConfig, variable_shapes


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
