"""Training of ProposalNet: the losses of the selection and of the residual, and their task.

The selector is trained first, then the residual of what it selects. Each is trained from prepared
inputs (:mod:`occjax.training.prepared`), or from light fields whose inputs are computed in every
step.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Bool, Float

from occjax.data.samples import LightFieldSample
from occjax.errors import InputError
from occjax.evaluation.metrics import BAD_PIXEL_THRESHOLD
from occjax.models import ProposalNet, ProposalNetConfig
from occjax.models.proposal import Selection
from occjax.models.proposal.network import random_variables
from occjax.models.proposal.residual import Residual, ResidualVolume
from occjax.training.config import LearnedPart, LossConfig, Precision
from occjax.training.losses import WeightedSum, bad_pixels, inside_border, penalty, weighted_sum
from occjax.training.prepared import (
    PackedProposals,
    PreparedSample,
    check_crop,
    proposals_and_truth,
    unpack,
    volume_and_truth,
)
from occjax.view_selection import ViewSelection

_OTHER_PART = (
    "the batches are prepared for the other part of ProposalNet; pass the same value of trained to "
    "make_source and TrainConfig"
)


@dataclass(frozen=True)
class ProposalTask:
    """Training of one part of ProposalNet; see :class:`occjax.training.tasks.TrainingTask`.

    Attributes:
        network: Configuration of the network, with a selector.
        loss_config: Settings of the loss.
        precision: Type of the convolutions.
        trained: The part that is trained.
        mesh: Devices that share a batch along the axis ``"data"``; None is one device.
    """

    network: ProposalNetConfig
    loss_config: LossConfig
    precision: Precision
    trained: LearnedPart = "selector"
    mesh: Mesh | None = None

    @property
    def frozen(self) -> tuple[str, ...]:
        """The other learned part, if the network has it."""
        if self.network.residual is None:
            return ()
        return ("residual",) if self.trained == "selector" else ("selector",)

    def view_selection(self, available: ViewSelection) -> ViewSelection:
        """Return the available views: the network takes any arrangement."""
        return available

    def init(self, key: Array, example: LightFieldSample | PreparedSample) -> dict:
        """Return random variables."""
        return random_variables(self.network, key)

    def errors(
        self, params: dict, batch_stats: dict, batch: LightFieldSample | PreparedSample
    ) -> tuple[dict[str, WeightedSum], dict]:
        """Compute the errors of a batch."""
        errors_of = self._errors
        if self.mesh is not None and self.mesh.size > 1:
            # The loop over the examples hides from XLA that they are on different devices.
            each = PartitionSpec(*self.mesh.axis_names)
            errors_of = jax.shard_map(
                errors_of,
                mesh=self.mesh,
                in_specs=(PartitionSpec(), each),
                out_specs=each,
                check_vma=False,
            )
        return errors_of(params, batch), batch_stats

    def _errors(
        self, params: dict, batch: LightFieldSample | PreparedSample
    ) -> dict[str, WeightedSum]:
        """Compute the errors of the examples of one device."""
        errors_of = self._selection_errors if self.trained == "selector" else self._residual_errors
        # On a CPU, one example after the other is faster than vmap and than a loop inside XLA.
        examples = [
            jax.tree.map(lambda field, index=index: field[index], batch)
            for index in range(batch.disparity.shape[0])
        ]
        errors = [errors_of({"params": params}, example) for example in examples]
        return jax.tree.map(lambda *fields: jnp.stack(fields), *errors)

    def _selection_errors(
        self, variables: dict, example: LightFieldSample | PreparedSample
    ) -> dict[str, WeightedSum]:
        if isinstance(example, PreparedSample):
            if not isinstance(example.packed, PackedProposals):
                raise InputError(_OTHER_PART)
            proposals, truth = unpack(example.packed), example.disparity
        else:
            check_crop(example.disparity.shape, self.network)
            proposals, truth = proposals_and_truth(example, self.network)
        network = ProposalNet(self.network, dtype=self.precision)
        selection = network.apply(variables, proposals, method="select")
        assert isinstance(selection, Selection)
        return selection_errors(selection, truth, example.valid, self.loss_config)

    def _residual_errors(
        self, variables: dict, example: LightFieldSample | PreparedSample
    ) -> dict[str, WeightedSum]:
        if isinstance(example, PreparedSample):
            if not isinstance(example.packed, ResidualVolume):
                raise InputError(_OTHER_PART)
            volume, truth = example.packed, example.disparity
        else:
            check_crop(example.disparity.shape, self.network)
            fixed = jax.lax.stop_gradient(variables)
            volume, truth = volume_and_truth(example, self.network, fixed)
        network = ProposalNet(self.network, dtype=self.precision)
        residual = network.apply(variables, volume, method="compute_residual")
        assert self.network.residual is not None
        assert isinstance(residual, Residual)
        return residual_errors(
            volume.disparity,
            residual,
            truth,
            example.valid,
            reach=2.0 * self.network.residual.candidates[-1],
            config=self.loss_config,
        )


def selection_errors(
    selection: Selection,
    truth: Float[Array, "h w"],
    valid: Bool[Array, "h w"],
    config: LossConfig,
) -> dict[str, WeightedSum]:
    """Compute the errors of a selection among proposals on one light field.

    Pixels count by :func:`selection_weight`. The cross-entropy rewards the probability of all
    accurate proposals together: ``-log(sum_k a_k p_k / max_k a_k)`` with the accuracies ``a``
    (:func:`proposal_accuracy`). The proposals of several neighbours on one surface are nearly
    equal, and it does not matter which one is selected.

    Args:
        selection: Selected disparity, proposals and their probabilities.
        truth: ``[h, w]`` true disparity in the units of the selection.
        valid: ``[h, w]`` pixels with ground truth.
        config: Settings of the loss.

    Returns:
        ``disparity``, the penalty of the selected disparity; ``distribution``, the cross-entropy in
        nats, unless its weight is 0; ``badpix``, the percentage of bad pixels, which is not part of
        the loss.

    Example:
        >>> proposed = jnp.array([0.2, 0.2, 0.9]).reshape(3, 1, 1)
        >>> selection = Selection(jnp.array([[0.2]]), proposed, jnp.full((3, 1, 1), 1 / 3))
        >>> config = LossConfig(distribution=1.0)
        >>> errors = selection_errors(selection, jnp.array([[0.2]]), jnp.array([[True]]), config)
        >>> {name: round(float(error.mean()), 3) for name, error in errors.items()}  # -log(2 / 3)
        {'disparity': 0.0, 'distribution': 0.405, 'badpix': 0.0}
    """
    # An unknown disparity may be NaN. A factor of zero does not remove it from a gradient.
    truth = jnp.where(valid, truth, 0.0)
    accuracy = proposal_accuracy(selection.proposed, truth, config)
    counted = inside_border(valid, config.border)
    weight = jnp.where(counted, selection_weight(accuracy, config.settled), 0.0)
    error = penalty(selection.disparity - truth, kind=config.penalty, width=config.width)
    errors = {"disparity": weighted_sum(error, weight)}
    if config.distribution > 0.0:
        # Relative to the most accurate proposal: the selection cannot be better than that one.
        accurate = (selection.probabilities * accuracy).sum(0) / jnp.maximum(accuracy.max(0), 1e-3)
        errors["distribution"] = weighted_sum(-jnp.log(jnp.maximum(accurate, 1e-6)), weight)
    return {**errors, "badpix": bad_pixels(selection.disparity, truth, valid, config.border)}


def residual_errors(
    disparity: Float[Array, "h w"],
    residual: Residual,
    truth: Float[Array, "h w"],
    valid: Bool[Array, "h w"],
    *,
    reach: float,
    config: LossConfig,
) -> dict[str, WeightedSum]:
    """Compute the errors of a disparity map with its residual.

    Pixels whose disparity is wrong by more than ``reach`` do not count in the penalty: they are too
    far from the truth for any residual to correct.

    Args:
        disparity: ``[h, w]`` disparity without the residual.
        residual: Residual, in the same units, and confidence.
        truth: ``[h, w]`` true disparity, in the same units.
        valid: ``[h, w]`` pixels with ground truth.
        reach: Largest error of the disparity of a pixel that counts.
        config: Settings of the loss.

    Returns:
        ``disparity``, the penalty of the disparity with the residual; ``distribution``, the
        cross-entropy in nats between the confidence and whether the pixel is correct (off by at
        most 0.07), over all pixels; ``badpix``, the percentage of bad pixels, which is not part of
        the loss.

    Example:
        >>> disparity, truth = jnp.array([[0.1, 5.0]]), jnp.zeros((1, 2))
        >>> residual = Residual(jnp.full((1, 2), -0.02), jnp.full((1, 2), 0.5))
        >>> errors = residual_errors(
        ...     disparity, residual, truth, truth == 0.0, reach=0.3, config=LossConfig()
        ... )
        >>> {name: round(float(error.mean()), 2) for name, error in errors.items()}
        {'disparity': 0.08, 'distribution': 0.69, 'badpix': 100.0}
    """
    truth = jnp.where(valid, truth, 0.0)
    inside = inside_border(valid, config.border)
    within_reach = inside & (jnp.abs(disparity - truth) < reach)
    error = disparity + residual.disparity - truth
    good = jnp.abs(error) <= BAD_PIXEL_THRESHOLD
    likelihood = jnp.where(good, residual.confidence, 1.0 - residual.confidence)
    return {
        "disparity": weighted_sum(
            penalty(error, kind=config.penalty, width=config.width), within_reach
        ),
        "distribution": weighted_sum(-jnp.log(jnp.maximum(likelihood, 1e-6)), inside),
        "badpix": bad_pixels(disparity + residual.disparity, truth, valid, config.border),
    }


def proposal_accuracy(
    proposed: Float[Array, "k h w"], truth: Float[Array, "h w"], config: LossConfig
) -> Float[Array, "k h w"]:
    """Compute how accurate each proposal is.

    Args:
        proposed: ``[k, h, w]`` proposed disparities.
        truth: ``[h, w]`` true disparity in the same units.
        config: Its ``accurate_error`` and ``wrong_error``, between which accuracy falls linearly.

    Returns:
        ``[k, h, w]`` from 1 (accurate) to 0 (wrong).

    Example:
        >>> errors = jnp.array([0.0, 0.08, 0.2]).reshape(3, 1, 1)
        >>> proposal_accuracy(errors, jnp.zeros((1, 1)), LossConfig())[:, 0, 0].round(2).tolist()
        [1.0, 0.5, 0.0]
    """
    width = config.wrong_error - config.accurate_error
    error = jnp.abs(proposed - truth[None])
    return jnp.clip((config.wrong_error - error) / width, 0.0, 1.0)


def selection_weight(accuracy: Float[Array, "k h w"], settled: float) -> Float[Array, "h w"]:
    """Compute the weight of each pixel in the loss of a selection.

    If no proposal is accurate, every selection is wrong, and training on the pixel would only teach
    that no proposal can be trusted. If at most one proposal is wrong, there is little to learn.

    Args:
        accuracy: ``[k, h, w]`` accuracy of the proposals; above 0.5 a proposal counts as accurate.
        settled: Weight of pixels at which at most one proposal is wrong.

    Returns:
        ``[h, w]`` weights: 0, ``settled`` or 1.

    Example:
        >>> accuracy = jnp.array([[1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])[:, None]
        >>> selection_weight(accuracy, 0.25).tolist()
        [[0.25, 1.0, 0.0]]
    """
    accurate = accuracy > 0.5
    wrong = (~accurate).sum(0, dtype=jnp.float32)
    return jnp.where(accurate.any(0), jnp.where(wrong <= 1.0, settled, 1.0), 0.0)
