"""What a training run is: frozen dataclasses, all of them changeable from the command line.

:class:`TrainConfig` holds what the weights depend on; a run that is resumed must have the same.
:class:`RunConfig` holds how a process goes about it and may change with every start.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal, get_args

from occjax.errors import InputError
from occjax.models.config import NetworkConfig

Penalty = Literal["l1", "huber", "sharp", "log"]
RateSchedule = Literal["constant", "cosine", "halving"]
Precision = Literal["float32", "bfloat16"]


def _one_of(name: str, value: str, choices: Any) -> None:
    if value not in get_args(choices):
        raise InputError(f"{name} is {' or '.join(get_args(choices))}, not {value!r}")


def _positive(name: str, value: int | float) -> None:
    if not value > 0:
        raise InputError(f"{name} is {value}; pass more than 0")


def _not_negative(name: str, value: int | float) -> None:
    if not value >= 0:
        raise InputError(f"{name} is {value}; pass 0 or more")


@dataclass(frozen=True)
class LossConfig:
    """What the network is told off for.

    Attributes:
        penalty: Of a disparity's error: ``"l1"`` as in the paper, ``"huber"`` (gentler where it is
            small), ``"sharp"`` (stricter there) or ``"log"`` (lenient where it is large); see
            :func:`occjax.training.losses.penalty`.
        width: Error at which the latter three change their slope, pixels per view step.
        stage_weights: Weight of each output of the cascade; none means 1 for each, as in the paper.
        distribution: Weight of the cross-entropy between each stage's probabilities and the ground
            truth.
        occlusion: Weight of the cross-entropy between each stage's occlusion weights and exact
            visibility. Only for sources that know visibility: elsewhere all views count as visible.
        border: Pixels left out at each side.
        settled: Of a choice among proposals, weight of the pixels for which at most one of them is
            wrong (:func:`occjax.training.losses.choice_weight`).
    """

    penalty: Penalty = "l1"
    width: float = 0.02
    stage_weights: tuple[float, ...] = ()
    distribution: float = 0.0
    occlusion: float = 0.0
    border: int = 0
    settled: float = 1.0

    def __post_init__(self) -> None:
        """Refuse what has no meaning."""
        _one_of("loss.penalty", self.penalty, Penalty)
        _positive("loss.width", self.width)
        for name in ("distribution", "occlusion", "border", "settled"):
            _not_negative(f"loss.{name}", getattr(self, name))
        for weight in self.stage_weights:
            _not_negative("loss.stage_weights", weight)


@dataclass(frozen=True)
class OptimiserConfig:
    """AdamW and its learning rate.

    Attributes:
        peak_rate: Highest learning rate.
        schedule: What follows the warm-up: ``"constant"``; ``"cosine"``, which falls to
            ``final_fraction`` at the last step; or ``"halving"`` as published:
            ``peak_rate * 0.5 ** floor((epoch + 1) / halving_epochs)``, epochs counted from 0.
        warm_up: Steps over which the rate rises linearly from nearly zero.
        final_fraction: Part of the peak that ``"cosine"`` ends with.
        epoch_steps: Steps of an epoch, for ``"halving"``.
        halving_epochs: Epochs between two halvings.
        first_moment: Decay of the gradients' running mean.
        second_moment: Decay of the squared gradients' running mean.
        weight_decay: Of the kernels, not of biases and normalisation; 0 is plain Adam.
        clip: Largest norm of the gradient of all parameters together; none does not clip.
    """

    peak_rate: float = 1e-3
    schedule: RateSchedule = "cosine"
    warm_up: int = 0
    final_fraction: float = 0.01
    epoch_steps: int = 4000
    halving_epochs: int = 30
    first_moment: float = 0.9
    second_moment: float = 0.999
    weight_decay: float = 0.0
    clip: float | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot train."""
        _one_of("optimiser.schedule", self.schedule, RateSchedule)
        for name in ("peak_rate", "epoch_steps", "halving_epochs"):
            _positive(f"optimiser.{name}", getattr(self, name))
        for name in ("warm_up", "final_fraction", "weight_decay"):
            _not_negative(f"optimiser.{name}", getattr(self, name))
        if self.clip is not None:
            _positive("optimiser.clip", self.clip)


@dataclass(frozen=True)
class TrainConfig:
    """Everything but the data that the trained weights depend on.

    Attributes:
        network: The network to train.
        loss: What is minimised.
        optimiser: How.
        steps: Number of steps; the learning rate's schedule ends with them.
        ema_decay: Decay of the running mean of weights and statistics, which is what is validated
            and shipped; 0 keeps the last weights only.
        precision: Type of the convolutions; parameters stay float32.
        seed: Of the first weights.
    """

    network: NetworkConfig
    loss: LossConfig = LossConfig()
    optimiser: OptimiserConfig = OptimiserConfig()
    steps: int = 20_000
    ema_decay: float = 0.999
    precision: Precision = "float32"
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse what cannot train."""
        _one_of("precision", self.precision, Precision)
        _positive("steps", self.steps)
        if not 0.0 <= self.ema_decay < 1.0:
            raise InputError(f"ema_decay is {self.ema_decay:g}; pass 0 or more, less than 1")


@dataclass(frozen=True)
class RunConfig:
    """How a process goes about training; nothing here changes the weights.

    Attributes:
        minutes: Stop, with a checkpoint, after this long; the next start goes on from there.
        checkpoint_minutes: Longest time between two checkpoints.
        checkpoint_steps: Steps between two checkpoints; none leaves it to the time.
        keep: Number of last checkpoints that are kept; the best one is kept besides.
        log_every: Steps between two lines of the log, each the mean over the steps between.
        validate_every: Steps between two validations; each makes a checkpoint.
        validation_border: Pixels that validation leaves out at each side.
        prefetch: Batches made ahead while the network trains.
    """

    minutes: float | None = None
    checkpoint_minutes: float = 10.0
    checkpoint_steps: int | None = None
    keep: int = 2
    log_every: int = 50
    validate_every: int = 1000
    validation_border: int = 15
    prefetch: int = 2

    def __post_init__(self) -> None:
        """Refuse what cannot run."""
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if value is not None and field.name != "validation_border":
                _positive(field.name, value)
        _not_negative("validation_border", self.validation_border)
