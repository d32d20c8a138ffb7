"""occjax as a candidate: inference, the network as it is written, and a step of training."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

import jax
import jax.numpy as jnp
import numpy as np

from experiments.bench.exchange import configure, unflatten
from experiments.bench.peers.description import Problem, Program
from experiments.cut_outs import cut_out
from occjax.data.sample import sample
from occjax.data.samples import Sample
from occjax.data.views import chosen_views
from occjax.inference import Estimator
from occjax.inference.network import infer
from occjax.models import OccCasNet, variable_shapes
from occjax.models.bundled import find_weights
from occjax.models.weights import load_weights
from occjax.ops import view_offsets
from occjax.training.config import OptimiserConfig, TrainConfig
from occjax.training.step import state_of, train_step


def peak_memory() -> int:
    """Largest memory of an accelerator that was in use, in bytes; 0 without one."""
    return int((jax.devices()[0].memory_stats() or {}).get("peak_bytes_in_use", 0))


def exact(precision: str) -> AbstractContextManager:
    """Where float32 means just that: a GPU else rounds it to 10 bits before it multiplies."""
    return jax.default_matmul_precision("float32" if precision == "float32" else "default")


def build(problem: Problem, *, precision: str = "float32") -> Program:
    """Inference of one light field.

    Args:
        problem: The network and the light field.
        precision: Of the convolutions, ``"float32"`` or ``"bfloat16"``.
    """
    config = configure(problem.network)
    return _inference(
        _variables(problem),
        problem.views[0],
        lambda variables, views: infer(variables, views, config, dtype=precision),
        precision,
    )


def build_written(problem: Problem) -> Program:
    """The network as the paper describes it, its volumes materialised, in float32."""
    network = OccCasNet(configure(problem.network))
    return _inference(_variables(problem), problem.views[0], network.apply, "float32")


def build_light(problem: Problem, *, precision: str = "float32") -> Program:
    """The light network with its bundled weights, on the views that an estimate looks at.

    Args:
        problem: The light field; its network does not matter.
        precision: Of the convolutions, ``"float32"`` or ``"bfloat16"``.
    """
    variables, config = load_weights(find_weights("light"))
    v, u, h, w = problem.views.shape[1:]
    offsets = np.asarray(view_offsets(v, u)).reshape(v * u, 2)
    seen = chosen_views(offsets, "outer_star")
    views = problem.views.reshape(1, v * u, h, w)[:, seen]

    place = jnp.asarray(offsets[None, seen])

    def stages(variables, views):
        return infer(variables, views, config, offsets=place, dtype=precision)

    return _inference(variables, views, stages, precision)


def build_sample(problem: Problem, *, side: int, precision: str = "float32") -> Program:
    """``occjax.estimate`` of the bundled sample by the light network, whatever the problem.

    Args:
        problem: Any.
        side: Of the square in its middle that is estimated, in pixels.
        precision: Of the convolutions, ``"float32"`` or ``"bfloat16"``.
    """
    estimator = Estimator("light", precision=precision)
    light_field = cut_out(sample(), side)
    return Program(lambda: estimator(light_field).disparity, peak_memory=peak_memory)


def train(problem: Problem, *, rate: float, precision: str = "float32") -> Program:
    """Steps of Adam on one batch, by the paper's loss.

    Args:
        problem: The network, the light fields and their disparity.
        rate: Of learning.
        precision: Of the convolutions, ``"float32"`` or ``"bfloat16"``.
    """
    config = TrainConfig(
        configure(problem.network),
        optimiser=OptimiserConfig(peak_rate=rate, schedule="constant"),
        precision=precision,
    )
    views, truth = jax.device_put((problem.views, problem.truth))
    offsets = view_offsets(*views.shape[1:3])
    batch = Sample(
        views,
        jnp.broadcast_to(offsets, (len(views), *offsets.shape)),
        truth,
        visibility=jnp.ones(views.shape, bool),
        valid=jnp.ones(truth.shape, bool),
    )
    state = state_of(_variables(problem), config)

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
    last = jax.jit(lambda variables, views: stages(variables, views)[-1].disparity)

    def run() -> jax.Array:
        with exact(precision):
            return jax.block_until_ready(last(*arguments))

    return Program(run, peak_memory=peak_memory)
