"""Time and memory of a network on this machine; each network runs in its own process."""

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
from occjax.models import OccCasNetConfig, predict, variable_shapes
from occjax.results.summary import peak_memory_bytes


class Measurement(NamedTuple):
    """Time and memory of an estimate.

    Attributes:
        seconds: Median time of an estimate, without compilation.
        memory: Peak memory in bytes: of the GPU, or without a GPU of the whole process.
    """

    seconds: float
    memory: int


def measure(config: OccCasNetConfig, size: int, *, repeats: int = 10) -> Measurement:
    """Measure estimates of one light field, computed as ``occjax estimate`` computes them.

    Peak memory counts from the start of a process, so each network needs its own process. If this
    process has used the GPU before, set ``XLA_PYTHON_CLIENT_PREALLOCATE=false``; otherwise it
    leaves no memory to the other process.

    Args:
        config: The network; its weights are arbitrary.
        size: Height and width of the views, in pixels.
        repeats: Number of timed estimates after a first one, which compiles.

    Returns:
        Median time and peak memory.

    Raises:
        InputError: If there are no repeats, or the process ends early, usually for lack of memory.
    """
    if repeats < 1 or size < 1:
        raise InputError(f"repeats and size must be 1 or more, not {repeats} and {size}")
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        try:
            return process.submit(_measure_here, config, size, repeats).result()
        except (BrokenProcessPool, jax.errors.JaxRuntimeError) as error:
            raise InputError(
                f"{size}x{size} pixels do not fit into memory; pass a smaller --size"
            ) from error


def _measure_here(config: OccCasNetConfig, size: int, repeats: int) -> Measurement:
    views = jax.random.uniform(jax.random.key(0), (*config.views, size, size))
    truth = jnp.zeros((size, size))
    # Compiling the initialisation would take longer than the measurement.
    variables = jax.tree.map(lambda leaf: jnp.full(leaf.shape, 0.02), variable_shapes(config))

    @jax.jit
    def estimate(variables, views, truth):
        return predict(variables, views, config, ground_truth=truth)[-1].disparity

    jax.block_until_ready(estimate(variables, views, truth))
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        jax.block_until_ready(estimate(variables, views, truth))
        seconds.append(time.perf_counter() - begin)
    device = jax.devices()[0].memory_stats() or {}
    return Measurement(
        statistics.median(seconds), int(device.get("peak_bytes_in_use", peak_memory_bytes()))
    )
