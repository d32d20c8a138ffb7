"""One training step, a pure function."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float, Int

from occjax.data.samples import LightFieldSample
from occjax.models import ModelConfig
from occjax.training.config import TrainConfig
from occjax.training.optimiser import make_optimiser
from occjax.training.prepared import PreparedSample
from occjax.training.tasks import task_of

Batch = LightFieldSample | PreparedSample
"""Training examples with a leading axis on every field: light fields, or prepared proposals."""

BatchSource = Callable[[int], Batch]
"""Returns the batch of a step, see :data:`occjax.data.sources.Source`."""


class TrainState(NamedTuple):
    """Everything that a step changes.

    There is no random key: a step draws nothing at random, and sources of data are functions of the
    number of the step.

    Attributes:
        step: ``[]`` number of finished steps.
        params: Parameters of the model.
        batch_stats: Running statistics of BatchNorm; empty if the model has none.
        opt_state: State of the optimiser.
        ema: Exponential moving average of ``{"params", "batch_stats"}``: the variables that are
            validated and written to the weights files.
    """

    step: Int[Array, ""]
    params: dict[str, Any]
    batch_stats: dict[str, Any]
    opt_state: optax.OptState
    ema: dict[str, Any]


def init_state(config: TrainConfig, batch: Batch) -> TrainState:
    """Return the state before the first step, with random weights.

    Args:
        config: Settings of the training.
        batch: A batch, for the shapes of its examples.

    Returns:
        The state, a function of ``config.seed``.

    Example:
        >>> from occjax.data.samples import numpy_sample
        >>> from occjax.models import preset
        >>> views, offsets = np.zeros((4, 3, 3, 16, 16), np.float32), np.zeros((4, 3, 3, 2))
        >>> batch = numpy_sample(views, offsets, views[:, 1, 1])
        >>> state = jax.eval_shape(partial(init_state, TrainConfig(preset("tiny"))), batch)
        >>> sorted(state.ema)
        ['batch_stats', 'params']
    """
    example = jax.tree.map(lambda field: jnp.asarray(field[0]), batch)
    return state_from_variables(_init(jax.random.key(config.seed), example, config.network), config)


@partial(jax.jit, static_argnames="network")
def _init(key: Array, example: Batch, network: ModelConfig) -> dict:
    return task_of(network).init(key, example)


def state_from_variables(variables: dict, config: TrainConfig) -> TrainState:
    """Return the state before the first step, with the given variables of the model."""
    params, batch_stats = variables["params"], variables.get("batch_stats", {})
    return TrainState(
        step=jnp.zeros((), jnp.int32),
        params=params,
        batch_stats=batch_stats,
        opt_state=make_optimiser(config.optimiser, config.steps).init(params),
        # A step donates its state, in which no buffer may occur twice.
        ema=jax.tree.map(jnp.copy, {"params": params, "batch_stats": batch_stats}),
    )


@partial(jax.jit, static_argnames="config", donate_argnames="state")
def train_step(
    state: TrainState, batch: Batch, *, config: TrainConfig
) -> tuple[TrainState, dict[str, Float[Array, ""]]]:
    """Update the weights once.

    BatchNorm uses the statistics of the whole batch, on however many devices it lies.

    Args:
        state: State before the step; its buffers are donated.
        batch: Training examples.
        config: Settings of the training.

    Returns:
        The state after the step, and the metrics of the batch before it: ``loss``; the errors of
        the model's task, such as ``disparity_0``; ``badpix``, the percentage of pixels with an
        error above 0.07; ``gradient_norm``, before clipping.

    Example:
        ::

            from occjax.training import init_state, make_source, recipe, train_step

            tiny = recipe("tiny")
            source = make_source(tiny.data, tiny.train.network)
            state = init_state(tiny.train, source(0))
            for step in range(100):
                state, metrics = train_step(state, source(step), config=tiny.train)
    """
    task = task_of(config.network, config.loss, config.precision)

    def loss_of(params):
        return task.loss(params, state.batch_stats, batch)

    gradient = jax.value_and_grad(loss_of, has_aux=True)
    (loss, (metrics, batch_stats)), gradients = gradient(state.params)
    optimiser = make_optimiser(config.optimiser, config.steps)
    with jax.numpy_dtype_promotion("standard"):  # optax raises a float to an integer power
        updates, opt_state = optimiser.update(gradients, state.opt_state, state.params)
    params = optax.apply_updates(state.params, updates)
    decay = ema_decay(config.ema_decay, state.step)
    ema = optax.incremental_update(
        {"params": params, "batch_stats": batch_stats}, state.ema, 1.0 - decay
    )
    metrics = {"loss": loss, **metrics, "gradient_norm": optax.tree.norm(gradients)}
    return TrainState(state.step + 1, params, batch_stats, opt_state, ema), metrics


def ema_decay(decay: float, step: Int[Array, ""]) -> Float[Array, ""]:
    """Return the decay of the moving average at a step: ``min(decay, (1 + step) / (10 + step))``.

    The average forgets fast at first; otherwise it would consist of the random initial weights.

    Example:
        >>> [round(float(ema_decay(0.99, jnp.int32(step))), 3) for step in (0, 8, 10_000)]
        [0.1, 0.5, 0.99]
    """
    done = step.astype(jnp.float32)
    return jnp.minimum(decay, (1.0 + done) / (10.0 + done))


def shardings(batch_size: int) -> tuple[NamedSharding, NamedSharding]:
    """Return the placement of batches and of states with which all devices share a step.

    A batch is divided over as many devices as divide it into equal parts, and a state is replicated
    on each of them.
    """
    devices = jax.devices()
    mesh = Mesh(np.array(devices[: math.gcd(batch_size, len(devices))]), ("devices",))
    return NamedSharding(mesh, PartitionSpec("devices")), NamedSharding(mesh, PartitionSpec())
