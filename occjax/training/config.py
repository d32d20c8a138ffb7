"""Settings of a training run: frozen dataclasses, whose fields are options of the command line.

:class:`TrainConfig` holds everything that the weights depend on except the data; a run must be
resumed with the same settings. :class:`RunConfig` holds settings that do not affect the weights and
may change with every start.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from occjax.data.config import AugmentationConfig
from occjax.data.procedural import SceneConfig
from occjax.errors import InputError, check_one_of
from occjax.models.registry import ModelConfig, Precision

Penalty = Literal["l1", "log", "truncated"]
RateSchedule = Literal["constant", "cosine", "halving"]
LearnedPart = Literal["selector", "residual"]


def _check_positive(config: object, prefix: str, *names: str) -> None:
    """Raise an error if one of the fields is neither None nor above 0."""
    for name in names:
        value = getattr(config, name)
        if value is not None and not value > 0:
            raise InputError(f"{prefix}{name} is {value}; pass more than 0")


def _check_not_negative(config: object, prefix: str, *names: str) -> None:
    """Raise an error if one of the fields is negative."""
    for name in names:
        value = getattr(config, name)
        if not value >= 0:
            raise InputError(f"{prefix}{name} is {value}; pass 0 or more")


def check_trained(trained: LearnedPart, network: ModelConfig) -> None:
    """Check that the network has the part that is to be trained.

    Raises:
        InputError: If it does not.
    """
    check_one_of("trained", trained, LearnedPart)
    if trained == "residual" and getattr(network, "residual", None) is None:
        raise InputError("the network has no residual to train; pass --trained selector")


@dataclass(frozen=True)
class LossConfig:
    """Training loss settings.

    Attributes:
        penalty: Penalty of the disparity error: ``"l1"`` as in the paper; ``"log"`` or
            ``"truncated"``, which limit the effect of large errors
            (:func:`occjax.training.losses.penalty`).
        width: Error at which the slope of ``"log"`` is halved, or above which ``"truncated"`` is
            constant, pixels per view step.
        distribution: Weight of the cross-entropy between the predicted probabilities and the ground
            truth, for the residual of ProposalNet that of its confidence; 0 disables it.
        border: Pixels left out at each side.
        settled: For the selector of ProposalNet, weight of pixels at which at most one proposal is
            wrong (:func:`occjax.training.proposal.selection_weight`).
        accurate_error: For this selector, largest error of an accurate proposal, pixels per view
            step.
        wrong_error: For this selector, smallest error of a wrong proposal, pixels per view step.
    """

    penalty: Penalty = "l1"
    width: float = 0.02
    distribution: float = 0.0
    border: int = 0
    settled: float = 1.0
    accurate_error: float = 0.04
    wrong_error: float = 0.12

    def __post_init__(self) -> None:
        """Check the values."""
        check_one_of("loss.penalty", self.penalty, Penalty)
        _check_positive(self, "loss.", "width")
        _check_not_negative(self, "loss.", "distribution", "border", "settled", "accurate_error")
        if not self.accurate_error < self.wrong_error:
            raise InputError(
                f"loss.wrong_error is {self.wrong_error}; it must be greater than "
                f"loss.accurate_error, {self.accurate_error}"
            )


@dataclass(frozen=True)
class OptimiserConfig:
    """Settings of AdamW and of its learning rate.

    Attributes:
        peak_rate: Highest learning rate.
        schedule: Learning rate after the warm-up: ``"constant"``; ``"cosine"``, which falls to
            ``final_fraction`` of the peak at the last step; or ``"halving"``, the published
            ``peak_rate * 0.5 ** floor((epoch + 1) / halving_epochs)``, epochs counted from 0.
        warm_up: Number of steps over which the rate rises linearly to the peak.
        final_fraction: Final rate of ``"cosine"`` divided by the peak rate.
        epoch_steps: Steps per epoch, for ``"halving"``.
        halving_epochs: Epochs between two halvings.
        weight_decay: Weight decay of kernels; biases and normalisation do not decay. 0 is Adam.
        clip: Largest norm of the gradient of all parameters together; None disables clipping.
    """

    peak_rate: float = 1e-3
    schedule: RateSchedule = "cosine"
    warm_up: int = 0
    final_fraction: float = 0.01
    epoch_steps: int = 4000
    halving_epochs: int = 30
    weight_decay: float = 0.0
    clip: float | None = None

    def __post_init__(self) -> None:
        """Check the values."""
        check_one_of("optimiser.schedule", self.schedule, RateSchedule)
        _check_positive(self, "optimiser.", "peak_rate", "epoch_steps", "halving_epochs", "clip")
        _check_not_negative(self, "optimiser.", "warm_up", "final_fraction", "weight_decay")


@dataclass(frozen=True)
class TrainConfig:
    """Settings that the trained weights depend on, except for the data.

    Attributes:
        network: Model to train.
        loss: Settings of the loss.
        optimiser: Settings of the optimiser.
        steps: Number of steps; the schedule of the learning rate ends with them.
        ema_decay: Decay of the exponential moving average of weights and statistics, which is
            validated and written to the weights files; 0 uses the last weights.
        precision: Type of the convolutions; parameters stay float32.
        accumulate: Number of micro-batches per step, whose gradients are added up. The memory of a
            step is that of one micro-batch. The time is a third longer, because the forward pass is
            computed twice (:func:`occjax.training.step.train_step`).
        rematerialise: Whether only the results of convolutions are kept for the gradients and
            everything else is computed again: less memory, more time.
        seed: Seed of the initial weights.
        trained: For ProposalNet, the part that is trained; the other one keeps its initial weights.
    """

    network: ModelConfig
    loss: LossConfig = LossConfig()
    optimiser: OptimiserConfig = OptimiserConfig()
    steps: int = 20_000
    ema_decay: float = 0.999
    precision: Precision = "float32"
    accumulate: int = 1
    rematerialise: bool = False
    seed: int = 0
    trained: LearnedPart = "selector"

    def __post_init__(self) -> None:
        """Check the values."""
        check_one_of("precision", self.precision, Precision)
        check_trained(self.trained, self.network)
        _check_positive(self, "", "steps", "accumulate")
        if not 0.0 <= self.ema_decay < 1.0:
            raise InputError(f"ema_decay is {self.ema_decay:g}; pass 0 or more, less than 1")


@dataclass(frozen=True)
class RunConfig:
    """Settings of a process that trains; none of them affects the weights.

    Attributes:
        minutes: Time after which training stops with a checkpoint; the next start resumes from it.
        checkpoint_minutes: Longest time between two checkpoints.
        checkpoint_steps: Number of steps between two checkpoints; None uses the time only.
        keep: Number of latest checkpoints to keep, in addition to the best one.
        log_every: Number of steps between two lines of the log, each the mean over these steps.
        validate_every: Number of steps between two validations, each with a checkpoint.
        prefetch: Number of batches that are prepared while the model trains.
        devices: Number of devices that share every batch; None is all devices.
        shard_state: Whether the devices share the parameters and the state of the optimiser, too:
            less memory, more communication. Otherwise every device holds a copy.
        skip_nonfinite: Number of successive steps that are skipped if their loss or gradient is not
            finite; after more of them, training stops. 0 stops at the first.
    """

    minutes: float | None = None
    checkpoint_minutes: float = 10.0
    checkpoint_steps: int | None = None
    keep: int = 2
    log_every: int = 50
    validate_every: int = 1000
    prefetch: int = 2
    devices: int | None = None
    shard_state: bool = False
    skip_nonfinite: int = 0

    def __post_init__(self) -> None:
        """Check the values."""
        any_value = {"shard_state", "skip_nonfinite"}
        names = {field.name for field in dataclasses.fields(self)}
        _check_positive(self, "", *sorted(names - any_value))
        _check_not_negative(self, "", "skip_nonfinite")


@dataclass(frozen=True)
class HostConfig:
    """Processes that train together.

    Attributes:
        distributed: Whether this process is one of several, started by SLURM, Cloud TPU, Open MPI
            or Kubernetes, where JAX detects the others.
        coordinator: Elsewhere, address ``HOST:PORT`` of process 0, the same for all processes.
        processes: Number of processes, with ``coordinator``.
        process: Number of this process, from 0, with ``coordinator``.
    """

    distributed: bool = False
    coordinator: str | None = None
    processes: int | None = None
    process: int | None = None

    def __post_init__(self) -> None:
        """Check that an address comes with its numbers."""
        given = [value is not None for value in (self.coordinator, self.processes, self.process)]
        if any(given) and not all(given):
            raise InputError("pass --coordinator HOST:PORT, --processes and --process together")


@dataclass(frozen=True)
class PatchConfig:
    """Choice of the patches that are cut out of prepared light fields.

    Attributes:
        draws: Number of random positions for a patch, of which the one with the most correctable
            pixels is used; for the residual, with the most wrong pixels.
        correctable_error: Error threshold in pixels per view step: above it a pixel counts as
            wrong, below it a proposal counts as correct.
    """

    draws: int = 4
    correctable_error: float = 0.05

    def __post_init__(self) -> None:
        """Check the number of positions."""
        _check_positive(self, "data.patches.", "draws")


@dataclass(frozen=True)
class DataConfig:
    """Sources of training data and their shares of every batch.

    Attributes:
        batch_size: Light fields per step.
        procedural_share: Relative share of procedural light fields; rendering them in every step
            needs a GPU.
        kept: Number of procedural light fields that are rendered before the first step, kept on the
            device and drawn from, 0.7 MB for each of 9x9 views and 64x64 pixels; 0 renders new ones
            in every step.
        scenes: Distribution of the procedural light fields.
        pools: Folders of procedural light fields that ``occjax pool`` rendered.
        pool_share: Relative share of the light fields of all pools together.
        prepared: For ProposalNet, folder in which the inputs of the part that is trained are kept
            for each light field of pools and folders (:mod:`occjax.training.prepared`).
        patches: Choice of the patches of prepared light fields.
        folders: Scenes with ground truth, or folders of such scenes.
        folder_share: Relative share of patches of these scenes.
        augmentation: Random variation of light fields; None disables it.
        seed: Seed of everything that is drawn at random.
    """

    batch_size: int = 16
    procedural_share: float = 1.0
    kept: int = 0
    scenes: SceneConfig = field(default_factory=SceneConfig)
    pools: tuple[Path, ...] = ()
    pool_share: float = 1.0
    prepared: Path | None = None
    patches: PatchConfig = field(default_factory=PatchConfig)
    folders: tuple[Path, ...] = ()
    folder_share: float = 1.0
    augmentation: AugmentationConfig | None = field(default_factory=AugmentationConfig)
    seed: int = 0
