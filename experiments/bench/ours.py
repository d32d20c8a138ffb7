"""Candidates of occjax: inference, materialised volumes, and a training step."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

import jax
import jax.numpy as jnp
import numpy as np

from experiments.bench.exchange import configure, unflatten
from experiments.bench.peers.description import Problem, Program
from experiments.cut_outs import small_sample
from occjax.data.samples import LightFieldSample
from occjax.estimators import make_estimator, run_estimator
from occjax.lightfield import LightField, view_offsets
from occjax.models import OccCasNet, predict, variable_shapes
from occjax.training.config import OptimiserConfig, TrainConfig
from occjax.training.step import state_from_variables, train_step

RANGE = (-4.0, 4.0)
"""Disparities that the proposal network searches, pixels per view step."""


def peak_memory() -> int:
    """Return the peak memory of the accelerator in bytes; 0 without an accelerator."""
    return int((jax.devices()[0].memory_stats() or {}).get("peak_bytes_in_use", 0))


def exact(precision: str) -> AbstractContextManager:
    """Disable TF32, which rounds float32 factors to 10 bits on a GPU."""
    return jax.default_matmul_precision("float32" if precision == "float32" else "default")


def build(problem: Problem, *, precision: str = "float32") -> Program:
    """Build the inference of one light field.

    Args:
        problem: The network and the light field.
        precision: Number type of convolutions, ``"float32"`` or ``"bfloat16"``.
    """
    config = configure(problem.network)
    return _inference(
        _variables(problem),
        problem.views[0],
        lambda variables, views: predict(variables, views, config, dtype=precision),
        precision,
    )


def build_materialised(problem: Problem) -> Program:
    """Build the network with materialised volumes, in float32."""
    network = OccCasNet(configure(problem.network))
    return _inference(_variables(problem), problem.views[0], network.apply, "float32")


def build_proposal(problem: Problem, *, precision: str = "float32") -> Program:
    """Build the proposal network with its bundled weights, on the views that an estimate uses.

    Args:
        problem: The light field; its network is unused.
        precision: Number type of convolutions, ``"float32"`` or ``"bfloat16"``.
    """
    estimator = make_estimator("proposal", precision=precision)
    inputs = estimator.prepare(LightField(problem.views[0][..., None]), RANGE)
    arguments = jax.device_put((inputs.variables, inputs.views, *inputs.arguments))
    return _program(lambda *given: estimator.run(*given)["disparity"], arguments, precision)


def build_sample(problem: Problem, *, side: int, precision: str = "float32") -> Program:
    """Build ``occjax.estimate`` of the bundled sample by the proposal network.

    Args:
        problem: Unused.
        side: Height and width of the central part, in pixels.
        precision: Number type of convolutions, ``"float32"`` or ``"bfloat16"``.
    """
    estimator, light_field = make_estimator("proposal", precision=precision), small_sample(side)
    return Program(lambda: run_estimator(estimator, light_field).disparity, peak_memory=peak_memory)


def train(problem: Problem, *, rate: float, precision: str = "float32") -> Program:
    """Build steps of Adam on one batch with the paper's loss.

    Args:
        problem: The network, the light fields and their disparity.
        rate: Learning rate.
        precision: Number type of convolutions, ``"float32"`` or ``"bfloat16"``.
    """
    config = TrainConfig(
        configure(problem.network),
        optimiser=OptimiserConfig(peak_rate=rate, schedule="constant"),
        precision=precision,
    )
    views, truth = jax.device_put((problem.views, problem.truth))
    offsets = view_offsets(*views.shape[1:3])
    batch = LightFieldSample(
        views,
        jnp.broadcast_to(offsets, (len(views), *offsets.shape)),
        truth,
        visibility=jnp.ones(views.shape, bool),
        valid=jnp.ones(truth.shape, bool),
    )
    state = state_from_variables(_variables(problem), config)

    def run():
        nonlocal state
        with exact(precision):
            state, metrics = train_step(state, batch, config=config)
        jax.block_until_ready(state)
        return metrics

    def fetch(metrics) -> np.ndarray:
        return np.array([metrics["loss"], metrics["gradient_norm"]], np.float32)

    return Program(run, fetch, peak_memory)


def _variables(problem: Problem) -> dict:
    shapes = variable_shapes(configure(problem.network))
    return jax.device_put(unflatten(problem.variables, shapes))


def _inference(variables: dict, views: np.ndarray, stages: Callable, precision: str) -> Program:
    arguments = jax.device_put((variables, views))
    return _program(lambda *given: stages(*given)[-1].disparity, arguments, precision)


def _program(disparity: Callable, arguments: tuple, precision: str) -> Program:
    compiled = jax.jit(disparity)

    def run() -> jax.Array:
        with exact(precision):
            return jax.block_until_ready(compiled(*arguments))

    return Program(run, peak_memory=peak_memory)
