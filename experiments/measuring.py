"""Time and memory of a network on this machine, each network in a process of its own."""

from __future__ import annotations

import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from typing import NamedTuple

import jax
import jax.numpy as jnp

from occjax.errors import InputError
from occjax.inference.network import infer
from occjax.inference.summary import peak_memory_bytes
from occjax.models import NetworkConfig, variable_shapes
from occjax.models.config import of_kind


class Measured(NamedTuple):
    """What running a network took.

    Attributes:
        seconds: Median time of an estimate, once compiled.
        memory: Peak in bytes: of the GPU's memory, without one of the whole process.
    """

    seconds: float
    memory: int


def measure(config: NetworkConfig, size: int, *, repeats: int = 10) -> Measured:
    """Estimate a light field as ``occjax estimate`` does, several times.

    Memory is counted from the start of a process, and a network must not pay for the one before,
    so that each has its own process. A GPU that this process has used before has no room left for
    another, unless ``XLA_PYTHON_CLIENT_PREALLOCATE=false`` is set.

    Args:
        config: A network of a grid of views; the values of its weights do not matter.
        size: Height and width of the views, in pixels.
        repeats: Estimates, after a first one that is not timed.

    Returns:
        Time and memory.

    Raises:
        InputError: If there are no repeats, or the process is killed, as for lack of memory.
    """
    if repeats < 1 or size < 1:
        raise InputError(f"repeats and size must be 1 or more, not {repeats} and {size}")
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        try:
            return process.submit(_measure_here, config, size, repeats).result()
        except (BrokenProcessPool, jax.errors.JaxRuntimeError) as error:
            raise InputError(
                f"{size}x{size} pixels did not fit into memory; pass a smaller --size"
            ) from error


def _measure_here(config: NetworkConfig, size: int, repeats: int) -> Measured:
    shape = (*of_kind(config.views, tuple), size, size)
    views = jax.random.uniform(jax.random.key(0), shape)
    truth = jnp.zeros((size, size))
    # Compiling the initialisation would take longer than all that follows.
    variables = jax.tree.map(lambda leaf: jnp.full(leaf.shape, 0.02), variable_shapes(config))

    @jax.jit
    def estimate(variables, views, truth):
        return infer(variables, views, config, ground_truth=truth)[-1].disparity

    jax.block_until_ready(estimate(variables, views, truth))
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        jax.block_until_ready(estimate(variables, views, truth))
        seconds.append(time.perf_counter() - begin)
    device = jax.devices()[0].memory_stats() or {}
    return Measured(
        statistics.median(seconds), int(device.get("peak_bytes_in_use", peak_memory_bytes()))
    )
