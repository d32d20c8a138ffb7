"""AdamW with the learning rates that training uses."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import optax

from occjax.training.config import OptimiserConfig


def learning_rate(config: OptimiserConfig, steps: int) -> optax.Schedule:
    """Learning rate as a function of the step.

    Args:
        config: Its shape.
        steps: Length of the training, at whose last step ``"cosine"`` reaches its end.

    Returns:
        Function of the step, counted from 0.

    Example:
        >>> published = OptimiserConfig(schedule="halving", peak_rate=1e-3)
        >>> rate = learning_rate(published, 480_000)
        >>> [round(1e6 * float(rate(4000 * epoch))) for epoch in (0, 28, 29, 59, 89)]
        [1000, 1000, 500, 250, 125]
    """
    peak, warm_up, final = config.peak_rate, config.warm_up, config.final_fraction

    def rate(step):
        step = jnp.asarray(step, jnp.int32)
        factor = jnp.float32(1.0)
        if config.schedule == "cosine":
            fallen = (step - warm_up).astype(jnp.float32) / max(steps - 1 - warm_up, 1)
            wave = 0.5 + 0.5 * jnp.cos(jnp.pi * jnp.clip(fallen, 0.0, 1.0))
            factor = final + (1.0 - final) * wave
        elif config.schedule == "halving":
            halvings = (step // config.epoch_steps + 1) // config.halving_epochs
            factor = 0.5 ** halvings.astype(jnp.float32)
        risen = jnp.minimum((step + 1).astype(jnp.float32) / max(warm_up, 1), 1.0)
        return peak * factor * risen

    return rate


def make_optimiser(config: OptimiserConfig, steps: int) -> optax.GradientTransformation:
    """Clipping and AdamW; only kernels decay.

    Args:
        config: Rates and moments.
        steps: Length of the training.

    Returns:
        The gradient transformation.
    """

    def kernels(params):
        return jax.tree.map(lambda parameter: parameter.ndim > 1, params)

    adam = optax.adamw(
        learning_rate(config, steps),
        b1=config.first_moment,
        b2=config.second_moment,
        weight_decay=config.weight_decay,
        mask=kernels,
    )
    if config.clip is None:
        return adam
    return optax.chain(optax.clip_by_global_norm(config.clip), adam)
