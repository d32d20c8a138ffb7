"""Checkpoints of the whole training state, from which training resumes exactly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import orbax.checkpoint as ocp
from orbax.checkpoint.checkpoint_managers import preservation_policy

import occjax
from occjax.io.files import decoder_errors
from occjax.io.run_folder import open_run_folder, write_description
from occjax.training.step import TrainState

CHECKPOINTS = "checkpoints"
CONFIG_FILE = "config.json"
MAY_CHANGE = ("steps", "occjax")
"""Settings that may differ when training is resumed: it may be longer, and the package newer."""

SCORE_KEY = "score"
"""Name of the number that selects the best checkpoint; lower is better."""


class Checkpoints:
    """The checkpoints in a training folder. A context manager.

    Attributes:
        folder: Folder of the checkpoints.
    """

    def __init__(self, folder: Path, *, keep: int) -> None:
        self.folder = folder / CHECKPOINTS
        best = preservation_policy.BestN(get_metric_fn=_score, reverse=True, n=1)
        policy = preservation_policy.AnyPreservationPolicy(
            [preservation_policy.LatestN(keep), best]
        )
        self._manager = ocp.CheckpointManager(
            self.folder.absolute(),
            options=ocp.CheckpointManagerOptions(
                preservation_policy=policy,
                best_fn=_score,  # without it scores are not stored
                best_mode="min",
                # The next step donates the buffers of the state, so that a checkpoint cannot be
                # written while it runs.
                enable_async_checkpointing=False,
                cleanup_tmp_directories=True,
            ),
        )

    def __enter__(self) -> Checkpoints:
        return self

    def __exit__(self, *_: object) -> None:
        self._manager.close()

    @property
    def latest_step(self) -> int | None:
        """Step of the latest checkpoint; None if there is none."""
        return self._manager.latest_step()

    @property
    def best_score(self) -> float | None:
        """Score of the best checkpoint; None if no checkpoint has a score."""
        step = self._manager.best_step()
        score = math.inf if step is None else _score(self._manager.metrics(step))
        return None if math.isinf(score) else score

    def save(self, state: TrainState, *, score: float | None = None) -> None:
        """Write a checkpoint, unless its step has one, and remove those that are not kept.

        Args:
            state: The state.
            score: Result of the validation, if there was one; lower is better.
        """
        step = int(state.step)
        if step != self.latest_step:
            # The manager warns about checkpoints without a score.
            metrics = {SCORE_KEY: math.inf if score is None else score}
            self._manager.save(step, args=ocp.args.StandardSave(state), metrics=metrics)

    def restore(self, like: TrainState) -> TrainState:
        """Read the latest checkpoint.

        Args:
            like: Shapes, types and placement of a state's arrays, as ``jax.ShapeDtypeStruct``.

        Returns:
            The state.

        Raises:
            InputError: If the checkpoint cannot be read as a state of this training.
        """
        step = self.latest_step
        remedy = "remove that folder to resume from the checkpoint before it"
        what = "a complete checkpoint of this training"
        with decoder_errors(self.folder / str(step), what, remedy=remedy):
            return self._manager.restore(step, args=ocp.args.StandardRestore(like))


def open_training_folder(folder: Path, description: Mapping[str, Any]) -> None:
    """Create a training folder, or verify that an existing one has the same settings.

    Args:
        folder: Folder, which may be missing or empty.
        description: All settings that the weights depend on. Paths are stored as text.

    Raises:
        InputError: If the folder contains a training of other settings or something else, or cannot
            be written.
    """
    description = {"occjax": occjax.__version__, **description}
    open_run_folder(folder, CONFIG_FILE, description, contents="a training", may_differ=MAY_CHANGE)
    write_description(folder / CONFIG_FILE, description)


def _score(metrics: Mapping[str, float]) -> float:
    return metrics[SCORE_KEY]
