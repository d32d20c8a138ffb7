"""AdamW and the schedules of its learning rate."""

from __future__ import annotations

from collections.abc import Collection

import jax
import optax

from occjax.training.config import OptimiserConfig


def learning_rate(config: OptimiserConfig, steps: int) -> optax.Schedule:
    """Return the schedule of the learning rate.

    Args:
        config: Settings of the schedule.
        steps: Number of training steps; ``"cosine"`` ends at the last one.

    Returns:
        Function from the step, counted from 0, to the learning rate.

    Example:
        >>> published = OptimiserConfig(schedule="halving", peak_rate=1e-3)
        >>> rate = learning_rate(published, 480_000)
        >>> [round(1e6 * float(rate(4000 * epoch))) for epoch in (0, 28, 29, 59, 89)]
        [1000, 1000, 500, 250, 125]
    """
    peak, warm_up = config.peak_rate, config.warm_up
    schedule: optax.Schedule = optax.constant_schedule(peak)
    if config.schedule == "cosine":
        decay_steps = max(steps - 1 - warm_up, 1)
        schedule = optax.cosine_decay_schedule(peak, decay_steps, alpha=config.final_fraction)
    elif config.schedule == "halving":
        halving_steps = config.epoch_steps * config.halving_epochs
        halving = optax.exponential_decay(peak, halving_steps, decay_rate=0.5, staircase=True)

        # The exponent is floor((epoch + 1) / halving_epochs), with epochs that count from the first
        # step. The steps of this schedule count from the end of the warm-up.
        def schedule(step):
            return halving(step + warm_up + config.epoch_steps)

    if not warm_up:
        return schedule
    linear = optax.linear_schedule(peak / warm_up, peak, warm_up - 1)
    return optax.join_schedules([linear, schedule], [warm_up])


def make_optimiser(
    config: OptimiserConfig, steps: int, *, frozen: Collection[str] = ()
) -> optax.GradientTransformation:
    """Return AdamW (Loshchilov and Hutter, 2019) with clipped gradients.

    Weight decay applies to kernels only, not to biases and to the parameters of BatchNorm.

    Args:
        config: Settings of the optimiser.
        steps: Number of training steps.
        frozen: Names of the modules whose parameters do not change.

    Returns:
        The gradient transformation.

    Example:
        >>> import jax.numpy as jnp
        >>> optimiser = make_optimiser(OptimiserConfig(peak_rate=0.1, schedule="constant"), 10)
        >>> params = {"bias": jnp.zeros(2)}
        >>> updates, _ = optimiser.update({"bias": jnp.ones(2)}, optimiser.init(params), params)
        >>> updates["bias"].round(3).tolist()  # Adam's first step has the size of the rate
        [-0.10000000149011612, -0.10000000149011612]
    """

    def is_kernel(params):
        return jax.tree.map(lambda parameter: parameter.ndim > 1, params)

    adam = optax.adamw(
        learning_rate(config, steps), weight_decay=config.weight_decay, mask=is_kernel
    )
    if config.clip is not None:
        adam = optax.chain(optax.clip_by_global_norm(config.clip), adam)
    if not frozen:
        return adam

    def labels(params):
        return {module: "frozen" if module in frozen else "trained" for module in params}

    return optax.partition({"trained": adam, "frozen": optax.set_to_zero()}, labels)
