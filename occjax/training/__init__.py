"""Training: configuration, losses, the step, the loop, checkpoints and validation."""

from occjax.training.config import LossConfig, OptimiserConfig, RunConfig, TrainConfig
from occjax.training.data import DataConfig, make_source
from occjax.training.logging import read_log
from occjax.training.loop import Trained, train
from occjax.training.losses import cascade_loss
from occjax.training.optimiser import learning_rate, make_optimiser
from occjax.training.recipes import RECIPES, Recipe, recipe
from occjax.training.step import TrainState, init_state, train_step
from occjax.training.validation import Scene, scenes_from_batch, scenes_from_folders, validate

__all__ = [
    "RECIPES",
    "DataConfig",
    "LossConfig",
    "OptimiserConfig",
    "Recipe",
    "RunConfig",
    "Scene",
    "TrainConfig",
    "TrainState",
    "Trained",
    "cascade_loss",
    "init_state",
    "learning_rate",
    "make_optimiser",
    "make_source",
    "read_log",
    "recipe",
    "scenes_from_batch",
    "scenes_from_folders",
    "train",
    "train_step",
    "validate",
]
