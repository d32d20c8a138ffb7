"""Training of OccCasNet: the loss of the cascade and its task."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from occjax.data.samples import LightFieldSample
from occjax.models import OccCasNet, OccCasNetConfig, StageOutput
from occjax.models.occcasnet.layers import BATCH_AXIS
from occjax.training.config import LossConfig, Precision
from occjax.training.losses import (
    WeightedSum,
    bad_pixels,
    inside_border,
    penalty,
    total_loss,
    weighted_sum,
)
from occjax.view_selection import ViewSelection


@dataclass(frozen=True)
class OccCasNetTask:
    """Training of OccCasNet; see :class:`occjax.training.tasks.TrainingTask`.

    Attributes:
        network: Configuration of the network.
        loss_config: Settings of the loss.
        precision: Type of the convolutions.
    """

    network: OccCasNetConfig
    loss_config: LossConfig
    precision: Precision

    @property
    def frozen(self) -> tuple[str, ...]:
        """Nothing is frozen."""
        return ()

    def view_selection(self, available: ViewSelection) -> ViewSelection:
        """Return the grid of the network."""
        return self.network.views

    def init(self, key: Array, example: LightFieldSample) -> dict:
        """Return random variables."""
        return dict(
            OccCasNet(self.network).init(key, example.views, **self.truth_arguments(example))
        )

    def errors(
        self, params: dict, batch_stats: dict, batch: LightFieldSample
    ) -> tuple[dict[str, WeightedSum], dict]:
        """Compute the errors of a batch; BatchNorm uses the statistics of the whole batch."""
        outputs, batch_stats = self.apply(params, batch_stats, batch)
        errors = cascade_errors(outputs, batch, self.loss_config)
        count_bad = partial(bad_pixels, border=self.loss_config.border)
        bad = jax.vmap(count_bad)(outputs[-1].disparity, batch.disparity, batch.valid)
        return {**errors, "badpix": bad}, batch_stats

    def apply(
        self, params: dict, batch_stats: dict, batch: LightFieldSample
    ) -> tuple[tuple[StageOutput, ...], dict]:
        """Apply the network in training mode.

        Args:
            params: Parameters.
            batch_stats: Running statistics of BatchNorm.
            batch: Samples with a leading axis on every field.

        Returns:
            Outputs with a leading axis on every field, and the new running statistics.
        """
        network = OccCasNet(self.network, dtype=self.precision)

        def apply_to_one(sample):
            outputs, changed = network.apply(
                {"params": params, "batch_stats": batch_stats},
                sample.views,
                train=True,
                **self.truth_arguments(sample),
                mutable=["batch_stats"],
            )
            return outputs, changed.get("batch_stats", {})

        return jax.vmap(apply_to_one, axis_name=BATCH_AXIS, out_axes=(0, None))(batch)

    def truth_arguments(self, sample: LightFieldSample) -> dict[str, Any]:
        """Return the true disparity and visibility, which some networks use."""
        truth = jnp.where(sample.valid, sample.disparity, 0.0)
        return {"ground_truth": truth, "visibility": sample.visibility}


def cascade_loss(
    outputs: tuple[StageOutput, ...], batch: LightFieldSample, config: LossConfig
) -> tuple[Float[Array, ""], dict[str, Float[Array, ""]]]:
    """Compute the loss of a cascade: the sum of the errors of all stages.

    With the default settings this is the mean absolute error of each stage's disparity (Chao et
    al., 2023, eq. 11); the cross-entropy of the probabilities can be added.

    Args:
        outputs: Output of each stage, with a batch axis on every field.
        batch: Samples with a leading axis on every field; disparity in pixels per view step.
        config: Settings of the loss.

    Returns:
        The loss, and the mean of each error over the pixels that count: ``disparity_0``,
        ``distribution_0`` and so on, numbered by stage. A mean over no pixels is 0.

    Example:
        >>> views, offsets, truth = map(jnp.zeros, ((2, 1, 3, 4, 6), (2, 1, 3, 2), (2, 4, 6)))
        >>> batch = LightFieldSample(views, offsets, truth, views == 0, truth == 0)
        >>> probabilities, candidates = jnp.full((2, 2, 4, 6), 0.5), jnp.array([[0.0, 1.0]] * 2)
        >>> stage = StageOutput(truth + 0.5, probabilities, candidates)
        >>> loss, errors = cascade_loss((stage,), batch, LossConfig())
        >>> float(loss), list(errors)
        (0.5, ['disparity_0'])
    """
    errors = cascade_errors(outputs, batch, config)
    means = {name: error.mean() for name, error in errors.items()}
    return total_loss(means, config), means


def cascade_errors(
    outputs: tuple[StageOutput, ...], batch: LightFieldSample, config: LossConfig
) -> dict[str, WeightedSum]:
    """Compute the errors of all stages, see :func:`cascade_loss`, of each sample of a batch."""

    def errors_of_one(outputs, sample):
        before = [None, *(output.disparity for output in outputs[:-1])]
        return {
            f"{name}_{index}": error
            for index, (output, previous) in enumerate(zip(outputs, before, strict=True))
            for name, error in _stage_errors(output, previous, sample, config).items()
        }

    return jax.vmap(errors_of_one)(outputs, batch)


def distribution_error(
    probabilities: Float[Array, "d h w"],
    candidates: Float[Array, " d"],
    truth: Float[Array, "h w"],
) -> tuple[Float[Array, "h w"], Bool[Array, "h w"]]:
    """Compute the cross-entropy between a stage's probabilities and the true disparity.

    The target is the distribution over the two candidates next to the truth whose expectation is
    the truth.

    Args:
        probabilities: ``[d, h, w]`` probability of each candidate.
        candidates: ``[d]`` disparities or residuals, ascending, pixels per view step.
        truth: ``[h, w]`` true disparity; for residuals, minus the disparity of the stage before.

    Returns:
        ``[h, w]`` cross-entropy in nats, and ``[h, w]`` whether the truth lies within the
        candidates; elsewhere the cross-entropy is meaningless.

    Example:
        >>> even = jnp.full((2, 1, 1), 0.5)
        >>> entropy, covered = distribution_error(even, jnp.array([0.0, 1.0]), jnp.array([[0.3]]))
        >>> round(float(entropy[0, 0]), 3), bool(covered[0, 0])
        (0.693, True)
    """
    candidates = jax.lax.stop_gradient(candidates)[:, None, None]
    below = jnp.concatenate([2.0 * candidates[:1] - candidates[1:2], candidates[:-1]])
    above = jnp.concatenate([candidates[1:], 2.0 * candidates[-1:] - candidates[-2:-1]])
    rising = (truth[None] - below) / (candidates - below)
    falling = (above - truth[None]) / (above - candidates)
    target = jnp.clip(jnp.minimum(rising, falling), 0.0, 1.0)
    # Through the softmax, a probability that underflows to zero has the correct gradient at any
    # positive value; the smallest one changes the cross-entropy least.
    logarithm = jnp.log(jnp.maximum(probabilities, jnp.finfo(probabilities.dtype).tiny))
    entropy = -(target * logarithm).sum(0)
    return entropy, (truth >= candidates[0]) & (truth <= candidates[-1])


def _stage_errors(
    output: StageOutput,
    before: Float[Array, "h w"] | None,
    sample: LightFieldSample,
    config: LossConfig,
) -> dict[str, WeightedSum]:
    """Return the errors of one stage on one light field; errors of weight 0 are left out."""
    counted = inside_border(sample.valid, config.border)
    # An unknown disparity may be NaN. A factor of zero does not remove it from a gradient.
    truth = jnp.where(sample.valid, sample.disparity, 0.0)
    error = penalty(output.disparity - truth, kind=config.penalty, width=config.width)
    errors = {"disparity": weighted_sum(error, counted)}
    if config.distribution > 0.0:
        relative = truth if before is None else truth - jax.lax.stop_gradient(before)
        entropy, covered = distribution_error(output.probabilities, output.candidates, relative)
        errors["distribution"] = weighted_sum(entropy, counted & covered)
    return errors
