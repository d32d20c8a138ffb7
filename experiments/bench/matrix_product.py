"""A matrix product, the most operations per second that a candidate could reach."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from experiments.bench.ours import exact, peak_memory
from experiments.bench.peers.description import Problem, Program


def flops(side: int) -> int:
    """Operations of the product of two square matrices, a multiply-add as two."""
    return 2 * side**3


def build(problem: Problem, *, side: int, precision: str = "float32") -> Program:
    """The product of two fixed matrices, summed in float32; the problem does not matter.

    Args:
        problem: Any.
        side: Rows and columns of the matrices.
        precision: Of the matrices, ``"float32"`` or ``"bfloat16"``.
    """
    # Random: a processor that is held to a power is faster with numbers that are all alike.
    matrix = jax.random.normal(jax.random.key(0), (side, side), precision)
    product = jax.jit(partial(jnp.matmul, preferred_element_type=jnp.float32))

    def run() -> jax.Array:
        with exact(precision):
            return jax.block_until_ready(product(matrix, matrix))

    return Program(run, lambda result: np.asarray(result[0, 0]), peak_memory)
