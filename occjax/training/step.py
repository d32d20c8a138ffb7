"""One step of training, a pure function."""

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

from occjax.data.samples import Sample
from occjax.models import NetworkConfig, OccCasNet, StageOutput
from occjax.models.layers import BATCH_AXIS
from occjax.training.config import TrainConfig
from occjax.training.losses import cascade_loss, inside_border
from occjax.training.optimiser import make_optimiser
from occjax.training.prepared import PreparedSample, unpack

Batch = Sample | PreparedSample
"""What a step takes: light fields, or what the choice of a light network needs of them."""

BatchSource = Callable[[int], Batch]
"""Gives the batch of a step, see :data:`occjax.data.sources.Source`."""

BAD = 0.07
"""Error above which a pixel counts as bad in the log, pixels per view step."""


class TrainState(NamedTuple):
    """Everything that a step changes.

    There is no random key: nothing in a step is drawn at random, and sources of data are functions
    of the step's number.

    Attributes:
        step: ``[]`` number of steps done.
        params: Parameters of the network.
        batch_stats: Running statistics of its BatchNorm, an empty dict if it has none.
        opt_state: Of the optimiser.
        ema: Running mean of ``{"params", "batch_stats"}``: the variables to validate and to ship.
    """

    step: Int[Array, ""]
    params: dict[str, Any]
    batch_stats: dict[str, Any]
    opt_state: optax.OptState
    ema: dict[str, Any]


def init_state(config: TrainConfig, batch: Batch) -> TrainState:
    """State before the first step, with random weights.

    Args:
        config: The training.
        batch: Examples of the kind that will be trained on, for their shapes.

    Returns:
        The state; the same for the same seed.
    """
    one = jax.tree.map(lambda field: jnp.asarray(field[0]), batch)
    return state_of(_first_variables(jax.random.key(config.seed), one, config.network), config)


@partial(jax.jit, static_argnames="network")
def _first_variables(key: Array, one: Batch, network: NetworkConfig) -> dict:
    if isinstance(one, PreparedSample):
        return dict(OccCasNet(network).init(key, unpack(one.packed), method="choose"))
    return dict(OccCasNet(network).init(key, one.views, **network_inputs(network, one)))


def state_of(variables: dict, config: TrainConfig) -> TrainState:
    """State before the first step, with given weights.

    Args:
        variables: Of the network.
        config: The training.

    Returns:
        The state.
    """
    params, batch_stats = variables["params"], variables.get("batch_stats", {})
    return TrainState(
        step=jnp.zeros((), jnp.int32),
        params=params,
        batch_stats=batch_stats,
        opt_state=make_optimiser(config.optimiser, config.steps).init(params),
        # A step donates its state, where no buffer may occur twice.
        ema=jax.tree.map(jnp.copy, {"params": params, "batch_stats": batch_stats}),
    )


@partial(jax.jit, static_argnames="config", donate_argnames="state")
def train_step(
    state: TrainState, batch: Batch, *, config: TrainConfig
) -> tuple[TrainState, dict[str, Float[Array, ""]]]:
    """One step of the optimiser on a batch.

    BatchNorm takes its statistics over the whole batch, on however many devices it lies.

    Args:
        state: Before the step; its buffers are given away.
        batch: The examples.
        config: The training.

    Returns:
        The state after the step, and of the batch before it: ``loss``, the errors that
        :func:`occjax.training.losses.cascade_loss` names, ``badpix`` (percentage of errors of the
        last output above 0.07) and ``gradient_norm`` (before clipping).
    """

    def loss_of(params):
        outputs, batch_stats = apply_to_batch(params, state.batch_stats, batch, config)
        loss, errors = cascade_loss(outputs, batch, config.loss)
        return loss, (outputs[-1].disparity, errors, batch_stats)

    gradient = jax.value_and_grad(loss_of, has_aux=True)
    (loss, (disparity, errors, batch_stats)), gradients = gradient(state.params)
    optimiser = make_optimiser(config.optimiser, config.steps)
    with jax.numpy_dtype_promotion("standard"):  # optax raises a float to an integer power
        updates, opt_state = optimiser.update(gradients, state.opt_state, state.params)
    params = optax.apply_updates(state.params, updates)
    decay = ema_decay(config.ema_decay, state.step)
    ema = optax.incremental_update(
        {"params": params, "batch_stats": batch_stats}, state.ema, 1.0 - decay
    )
    metrics = {
        "loss": loss,
        **errors,
        "badpix": _bad_percentage(disparity, batch, config.loss.border),
        "gradient_norm": optax.tree.norm(gradients),
    }
    return TrainState(state.step + 1, params, batch_stats, opt_state, ema), metrics


def apply_to_batch(
    params: dict, batch_stats: dict, batch: Batch, config: TrainConfig
) -> tuple[tuple[StageOutput, ...], dict]:
    """The network in training, on every example of a batch.

    Args:
        params: Parameters.
        batch_stats: Running statistics of BatchNorm.
        batch: The examples.
        config: The training.

    Returns:
        Outputs with a batch axis on every field, and the new running statistics.
    """
    network = OccCasNet(config.network, dtype=config.precision)
    variables = {"params": params, "batch_stats": batch_stats}

    def one(sample):
        outputs, changed = network.apply(
            variables,
            sample.views,
            train=True,
            mutable=["batch_stats"],
            **network_inputs(config.network, sample),
        )
        return outputs, changed.get("batch_stats", {})

    if config.network.views is not None:
        return jax.vmap(one, axis_name=BATCH_AXIS, out_axes=(0, None))(batch)

    def choice(sample: PreparedSample):
        before = StageOutput(sample.packed.disparity, None, None)
        return before, network.apply(variables, unpack(sample.packed), method="choose")

    # No statistics are shared. One example after the other is quicker on a CPU than vmap, and than
    # a loop that XLA sees.
    outputs = []
    for index in range(batch.disparity.shape[0]):
        sample = jax.tree.map(lambda field, index=index: field[index], batch)
        outputs.append(choice(sample) if isinstance(sample, PreparedSample) else one(sample)[0])
    return jax.tree.map(lambda *fields: jnp.stack(fields), *outputs), batch_stats


def ema_decay(decay: float, step: Int[Array, ""]) -> Float[Array, ""]:
    """Decay of the running mean at a step: ``min(decay, (1 + step) / (10 + step))``.

    Early on the mean forgets fast, or it would be made of the random first weights.

    Example:
        >>> [round(float(ema_decay(0.99, jnp.int32(step))), 3) for step in (0, 8, 10_000)]
        [0.1, 0.5, 0.99]
    """
    done = step.astype(jnp.float32)
    return jnp.minimum(decay, (1.0 + done) / (10.0 + done))


def shardings(batch_size: int) -> tuple[NamedSharding, NamedSharding]:
    """Where to put a batch and a state, so that all devices share a step.

    Args:
        batch_size: Number of examples in a batch.

    Returns:
        Sharding of a batch, over as many devices as divide it into equal parts, and that of a
        state, whole on each of them.
    """
    devices = jax.devices()
    mesh = Mesh(np.array(devices[: math.gcd(batch_size, len(devices))]), ("devices",))
    return NamedSharding(mesh, PartitionSpec("devices")), NamedSharding(mesh, PartitionSpec())


def takes_offsets(network: NetworkConfig) -> bool:
    """Whether a network is told where its views are, being made for any arrangement of them."""
    return network.views is None


def network_inputs(network: NetworkConfig, sample: Sample) -> dict[str, Any]:
    """What a network is given beside the views.

    Args:
        network: Its configuration.
        sample: One light field.

    Returns:
        Keyword arguments of the network and of :func:`occjax.inference.network.infer`.
    """
    inputs: dict[str, Any] = {}
    if takes_offsets(network):
        inputs["offsets"] = sample.offsets
    if any(stage.occlusion == "ground_truth" for stage in network.stages):
        inputs["ground_truth"] = jnp.where(sample.valid, sample.disparity, 0.0)
    return inputs


def _bad_percentage(
    disparity: Float[Array, "b h w"], batch: Batch, border: int
) -> Float[Array, ""]:
    counted = jax.vmap(partial(inside_border, border=border))(batch.valid)
    bad = counted & (jnp.abs(disparity - batch.disparity) > BAD)
    return 100.0 * bad.mean(dtype=jnp.float32) / jnp.maximum(counted.mean(dtype=jnp.float32), 1e-9)
