"""One training step, a pure function."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jax.sharding import Mesh
from jaxtyping import Array, Float, Int

from occjax.data.samples import LightFieldSample
from occjax.models import ModelConfig
from occjax.training.config import TrainConfig
from occjax.training.losses import WeightedSum, total_loss
from occjax.training.optimiser import make_optimiser
from occjax.training.placement import Placement
from occjax.training.prepared import PreparedSample
from occjax.training.tasks import TrainingTask, task_of

Batch = LightFieldSample | PreparedSample
"""Training examples with a leading axis on every field: light fields, or prepared ones."""

BatchSource = Callable[..., Batch]
"""Returns the batch of a step, see :class:`occjax.data.sources.Source`.

Only several processes that train together call it with rows."""


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
        >>> import numpy as np
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


def _task(config: TrainConfig, mesh: Mesh | None = None) -> TrainingTask:
    return task_of(config.network, config.loss, config.precision, trained=config.trained, mesh=mesh)


def _optimiser(config: TrainConfig) -> optax.GradientTransformation:
    return make_optimiser(config.optimiser, config.steps, frozen=_task(config).frozen)


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
        opt_state=_optimiser(config).init(params),
        # A step donates its state, in which no buffer may occur twice.
        ema=jax.tree.map(jnp.copy, {"params": params, "batch_stats": batch_stats}),
    )


@partial(jax.jit, static_argnames=("config", "placement"), donate_argnames="state")
def train_step(
    state: TrainState,
    batch: Batch,
    *,
    config: TrainConfig,
    number: int | Int[Array, ""] | None = None,
    placement: Placement | None = None,
) -> tuple[TrainState, dict[str, Array]]:
    """Update the weights once.

    BatchNorm uses the statistics of the whole batch, also if several devices share it. With
    ``config.accumulate`` above 1 it normalises each micro-batch with the statistics of that
    micro-batch, on all devices together, and the running statistics move once, to the mean of
    those of the micro-batches. Models without BatchNorm get the gradient of the whole batch, up to
    rounding: errors are divided by the number of pixels of the whole batch.

    If the loss or its gradient is not finite, the state is returned unchanged, its ``step`` too.

    Args:
        state: State before the step; its buffers are donated.
        batch: Training examples.
        config: Settings of the training.
        number: Number of the step. If it is not that of the state, since an earlier step was
            refused, the state is returned unchanged. By default the number of the state.
        placement: Devices that share the batch; None is one device, or leaves it to JAX.

    Returns:
        The state after the step, and the metrics of the batch with the weights before the step:
        ``loss``; the errors of the model's task, such as ``disparity_0``; ``badpix``, the
        percentage of pixels with an error above 0.07; ``gradient_norm``, before clipping;
        ``applied``, whether the state has changed.

    Example:
        >>> import numpy as np
        >>> from occjax.data.samples import numpy_sample
        >>> from occjax.models import preset
        >>> views, offsets = np.zeros((4, 3, 3, 16, 16), np.float32), np.zeros((4, 3, 3, 2))
        >>> batch = numpy_sample(views, offsets, views[:, 1, 1])
        >>> config = TrainConfig(preset("tiny"))
        >>> state = jax.eval_shape(partial(init_state, config), batch)
        >>> after, metrics = jax.eval_shape(partial(train_step, config=config), state, batch)
        >>> sorted(metrics)[:4]
        ['applied', 'badpix', 'disparity_0', 'disparity_1']
    """
    (loss, (metrics, batch_stats)), gradients = _gradient(state, batch, config, placement)
    norm = optax.tree.norm(gradients)
    applied = jnp.isfinite(loss) & jnp.isfinite(norm)
    if number is not None:
        applied &= state.step == number
    optimiser = _optimiser(config)
    with jax.numpy_dtype_promotion("standard"):  # optax raises a float to an integer power
        updates, opt_state = optimiser.update(gradients, state.opt_state, state.params)
    params = optax.apply_updates(state.params, updates)
    decay = ema_decay(config.ema_decay, state.step)
    # Written so that parameters that do not change have an average that does not, either.
    ema = jax.tree.map(
        lambda average, value: average + (1.0 - decay) * (value - average),
        state.ema,
        {"params": params, "batch_stats": batch_stats},
    )
    after = TrainState(state.step + 1, params, batch_stats, opt_state, ema)
    after = jax.tree.map(partial(jnp.where, applied), after, state)
    if placement is not None:
        after = jax.lax.with_sharding_constraint(after, placement.state(after))
    return after, {"loss": loss, **metrics, "gradient_norm": norm, "applied": applied}


def _gradient(
    state: TrainState, batch: Batch, config: TrainConfig, placement: Placement | None = None
) -> tuple[tuple[Float[Array, ""], tuple[dict[str, Float[Array, ""]], dict]], dict]:
    """Compute the loss of a batch, with the metrics and the new statistics, and its gradient."""
    mesh = None if placement is None else placement.mesh
    errors = _task(config, mesh).errors
    if config.rematerialise:
        errors = jax.checkpoint(errors, policy=jax.checkpoint_policies.dots_saveable)
    if config.accumulate > 1:
        errors = partial(_accumulated, jax.checkpoint(errors), config.accumulate)

    def loss_of(params):
        sums, batch_stats = errors(params, state.batch_stats, batch)
        means = {name: error.mean() for name, error in sums.items()}
        return total_loss(means, config.loss), (means, batch_stats)

    return jax.value_and_grad(loss_of, has_aux=True)(state.params)


def _accumulated(
    errors: Callable, count: int, params: dict, batch_stats: dict, batch: Batch
) -> tuple[dict[str, WeightedSum], dict]:
    """Compute the errors of a batch in micro-batches, one after the other."""

    def split(field):
        # Every device has an equal part of each micro-batch.
        return jnp.moveaxis(field.reshape(-1, count, *field.shape[1:]), 1, 0)

    sums, new_stats = jax.lax.map(
        lambda micro_batch: errors(params, batch_stats, micro_batch), jax.tree.map(split, batch)
    )
    return sums, jax.tree.map(lambda statistic: statistic.mean(0), new_stats)


def ema_decay(decay: float, step: Int[Array, ""]) -> Float[Array, ""]:
    """Return the decay of the moving average at a step: ``min(decay, (1 + step) / (10 + step))``.

    The average forgets fast at first; otherwise it would consist of the random initial weights.

    Example:
        >>> [round(float(ema_decay(0.99, jnp.int32(step))), 3) for step in (0, 8, 10_000)]
        [0.1, 0.5, 0.99]
    """
    done = step.astype(jnp.float32)
    return jnp.minimum(decay, (1.0 + done) / (10.0 + done))
