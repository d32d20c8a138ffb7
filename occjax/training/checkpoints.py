"""Checkpoints of a training's whole state, from which it goes on exactly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import orbax.checkpoint as ocp
from orbax.checkpoint.checkpoint_managers import preservation_policy

import occjax
from occjax.errors import InputError
from occjax.io.claims import claim_folder, write_description
from occjax.training.step import TrainState

CHECKPOINTS = "checkpoints"
CONFIG_FILE = "config.json"
MAY_CHANGE = ("steps", "occjax")
"""What may differ when training is resumed: it can be made longer, and the package newer."""

SCORE = "score"
"""Name of the one number that says which checkpoint is best; lower is better."""


class Checkpoints:
    """The checkpoints in a training's folder. A context manager.

    Attributes:
        folder: Where they are.
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
                best_fn=_score,  # without which scores are not stored
                best_mode="min",
                # The next step gives the state's buffers away, so that a checkpoint cannot be
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
        """Step of the last checkpoint, None if there is none."""
        return self._manager.latest_step()

    @property
    def best(self) -> tuple[int, float] | None:
        """Step and score of the best checkpoint, None if none has a score."""
        step = self._manager.best_step()
        score = math.inf if step is None else _score(self._manager.metrics(step))
        return None if math.isinf(score) else (step, score)

    def save(self, state: TrainState, *, score: float | None = None) -> None:
        """Write a checkpoint, unless there is one of this step, and remove those not kept.

        Args:
            state: The state.
            score: How bad it is, if it has been validated.
        """
        step = int(state.step)
        if step != self.latest_step:
            # The manager warns of checkpoints without a score.
            metrics = {SCORE: math.inf if score is None else score}
            self._manager.save(step, args=ocp.args.StandardSave(state), metrics=metrics)

    def restore(self, like: TrainState, step: int | None = None) -> TrainState:
        """Read a checkpoint.

        Args:
            like: Shapes, types and places of a state's arrays, as ``jax.ShapeDtypeStruct``.
            step: Which; the last one by default.

        Returns:
            The state.

        Raises:
            InputError: If it cannot be read as a state of this training.
        """
        step = self.latest_step if step is None else step
        try:
            return self._manager.restore(step, args=ocp.args.StandardRestore(like))
        except (ValueError, KeyError, TypeError, OSError) as error:
            raise InputError(
                f"{self.folder / str(step)}: is not a whole checkpoint of this training; remove "
                "that folder to go on from the one before"
            ) from error


def claim_training(folder: Path, description: Mapping[str, Any]) -> None:
    """Make a folder that of a training, or see that it is already that of the same one.

    Args:
        folder: Of the training; may be missing or empty.
        description: What the weights depend on, as JSON can hold it; paths as text.

    Raises:
        InputError: If the folder holds another training, or something else, or cannot be written.
    """
    description = {"occjax": occjax.__version__, **description}
    claim_folder(folder, CONFIG_FILE, description, contents="a training", may_differ=MAY_CHANGE)
    write_description(folder / CONFIG_FILE, description)


def _score(metrics: Mapping[str, float]) -> float:
    return metrics[SCORE]
