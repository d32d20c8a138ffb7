"""Random variables of a network, made by NumPy: compiling ``init`` takes longer than most tests."""

import jax
import jax.numpy as jnp
import numpy as np

from occjax.models import NetworkConfig, OccCasNet


def random_variables(config: NetworkConfig, seed: int = 0) -> dict:
    """Kernels scaled by their fan-in; scales and variances near one, the rest near zero."""
    generator = np.random.default_rng(seed)

    def draw(path, leaf):
        noise = generator.normal(size=leaf.shape)
        name = path[-1].key
        if name == "kernel":
            value = noise * np.sqrt(2 / np.prod(leaf.shape[:-1]))
        else:
            value = 0.2 * np.abs(noise) + 0.9 if name in ("scale", "var") else 0.2 * noise
        return jnp.asarray(value, leaf.dtype)

    views = jax.ShapeDtypeStruct((*(config.views or (1, 3)), 16, 16), jnp.float32)
    shapes = jax.eval_shape(OccCasNet(config).init, jax.random.key(0), views)
    return jax.tree_util.tree_map_with_path(draw, shapes)
