"""What training needs from a model: one task for each kind of model.

A new model adds a module with its task and an entry in :func:`task_of`.
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from jax.sharding import Mesh
from jaxtyping import Array

from occjax.errors import InputError
from occjax.models import ModelConfig, OccCasNetConfig, ProposalNetConfig
from occjax.training.config import LearnedPart, LossConfig, Precision, check_trained
from occjax.training.losses import WeightedSum
from occjax.training.occcasnet import OccCasNetTask
from occjax.training.proposal import ProposalTask
from occjax.view_selection import ViewSelection


@runtime_checkable
class TrainingTask(Protocol):
    """Training of one kind of model. All methods but ``view_selection`` can be jitted."""

    @property
    def frozen(self) -> tuple[str, ...]:
        """Names of the modules whose parameters do not change."""
        ...

    def view_selection(self, available: ViewSelection) -> ViewSelection:
        """Return the views that the model takes.

        Args:
            available: Views of the training data.

        Returns:
            ``(V, U)`` for a model of a fixed grid; otherwise a selection of the available views.
        """
        ...

    def init(self, key: Array, example: Any) -> dict:
        """Return random variables of the model.

        Args:
            key: Random key.
            example: Training example without a batch axis, for its shape.
        """
        ...

    def errors(
        self, params: dict, batch_stats: dict, batch: Any
    ) -> tuple[dict[str, WeightedSum], dict]:
        """Compute the errors of each example of a batch.

        Args:
            params: Parameters of the model.
            batch_stats: Running statistics of BatchNorm; empty for a model without BatchNorm.
            batch: Training examples, with a leading axis on every field.

        Returns:
            Errors by name, each summed over the pixels of each example: those of the loss
            (:func:`occjax.training.losses.total_loss`) and ``badpix`` (percentage of pixels with an
            error above 0.07); and the new running statistics.
        """
        ...


def task_of(
    network: ModelConfig,
    loss: LossConfig | None = None,
    precision: Precision = "float32",
    *,
    trained: LearnedPart = "selector",
    mesh: Mesh | None = None,
) -> TrainingTask:
    """Return the training task of a model.

    Args:
        network: Configuration of the model.
        loss: Settings of the loss; the defaults if None.
        precision: Type of the convolutions.
        trained: For ProposalNet, the part that is trained.
        mesh: Devices that share a batch along the axis ``"data"``; None is one device.

    Returns:
        The task.

    Raises:
        InputError: If the model has nothing to train, or not this part.

    Example:
        >>> from occjax.models import preset
        >>> task_of(preset("tiny")).view_selection("all")
        (3, 3)
    """
    loss = loss or LossConfig()
    if isinstance(network, OccCasNetConfig):
        return OccCasNetTask(network, loss, precision)
    if isinstance(network, ProposalNetConfig) and network.selector is not None:
        check_trained(trained, network)
        return ProposalTask(network, loss, precision, trained, mesh)
    raise InputError("the model has no weights to train; choose another --network-preset")
