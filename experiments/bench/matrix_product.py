"""Matrix product, whose operations per second are the upper limit of a candidate."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from experiments.bench.ours import exact, peak_memory
from experiments.bench.peers.description import Problem, Program


def flops(side: int) -> int:
    """Return the operations of a product of square matrices; a multiply-add counts as two."""
    return 2 * side**3


def build(problem: Problem, *, side: int, precision: str = "float32") -> Program:
    """Build the product of two fixed matrices with float32 accumulation.

    Args:
        problem: Unused.
        side: Rows and columns of the matrices.
        precision: Number type of the matrices, ``"float32"`` or ``"bfloat16"``.
    """
    # Constant matrices would need less power, and a processor at its power limit would be faster.
    matrix = jax.random.normal(jax.random.key(0), (side, side), precision)
    product = jax.jit(partial(jnp.matmul, preferred_element_type=jnp.float32))

    def run() -> jax.Array:
        with exact(precision):
            return jax.block_until_ready(product(matrix, matrix))

    return Program(run, lambda result: np.asarray(result[0, 0]), peak_memory)
