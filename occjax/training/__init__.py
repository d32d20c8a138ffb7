"""Training: settings, losses, the step, the loop, checkpoints and validation.

Reading order: :mod:`config`, :mod:`recipes`, :mod:`data`, :mod:`loop`, :mod:`step`, :mod:`tasks`;
then the task of a model, :mod:`occcasnet` or :mod:`proposal`.
"""

from occjax.training.config import LossConfig, OptimiserConfig, RunConfig, TrainConfig
from occjax.training.data import DataConfig, make_source
from occjax.training.logging import read_log
from occjax.training.loop import Trained, train
from occjax.training.occcasnet import cascade_loss
from occjax.training.optimiser import learning_rate, make_optimiser
from occjax.training.proposal import selection_errors
from occjax.training.recipes import RECIPES, Recipe, recipe
from occjax.training.step import TrainState, init_state, train_step
from occjax.training.tasks import TrainingTask, task_of
from occjax.training.validation import (
    scenes_from_batch,
    scenes_from_folders,
    validate,
)

__all__ = [
    "RECIPES",
    "DataConfig",
    "LossConfig",
    "OptimiserConfig",
    "Recipe",
    "RunConfig",
    "TrainConfig",
    "TrainState",
    "Trained",
    "TrainingTask",
    "cascade_loss",
    "init_state",
    "learning_rate",
    "make_optimiser",
    "make_source",
    "read_log",
    "recipe",
    "scenes_from_batch",
    "scenes_from_folders",
    "selection_errors",
    "task_of",
    "train",
    "train_step",
    "validate",
]
