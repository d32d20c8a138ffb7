"""Checkpoints of the whole training state, from which training resumes exactly."""

from __future__ import annotations

import hashlib
import json
import logging
import math
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import orbax.checkpoint as ocp
from orbax.checkpoint.checkpoint_managers import preservation_policy

import occjax
from occjax.errors import InputError, warn
from occjax.io.atomic import CannotWriteError, atomic_path
from occjax.io.run_folder import open_run_folder, write_description
from occjax.training.hosts import on_first_process
from occjax.training.step import TrainState

CHECKPOINTS = "checkpoints"
DAMAGED = "damaged_checkpoints"
CHECKSUMS = "sha256.json"
CONFIG_FILE = "config.json"
MAY_CHANGE = ("steps", "rematerialise", "occjax")
"""Settings that may differ when training is resumed: it may be longer, and the package newer."""

SCORE_KEY = "score"
"""Name of the number that selects the best checkpoint; lower is better."""


class Checkpoints:
    """The checkpoints in a training folder. A context manager.

    If several processes train, they call every method together.

    Attributes:
        folder: Folder of the checkpoints.
    """

    def __init__(self, folder: Path, *, keep: int) -> None:
        self.folder = folder / CHECKPOINTS
        on_first_process(partial(_remove_damaged_scores, self.folder))
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

        Raises:
            InputError: If it cannot be written. The earlier checkpoints are kept.
        """
        step = int(state.step)
        if step != self.latest_step:
            # The manager warns about checkpoints without a score.
            metrics = {SCORE_KEY: math.inf if score is None else score}
            with writing_checkpoint(self.folder):
                self._manager.save(step, args=ocp.args.StandardSave(state), metrics=metrics)
            on_first_process(partial(_write_checksums, self.folder / str(step)))

    def restore(self, like: TrainState) -> TrainState:
        """Read the latest checkpoint that is intact.

        Damaged ones are moved to the folder ``damaged_checkpoints``, with a warning.

        Args:
            like: Shapes, types and placement of a state's arrays, as ``jax.ShapeDtypeStruct``.

        Raises:
            InputError: If no checkpoint can be read as a state of this training. All of them then
                stay where they are.
        """
        steps = sorted(self._manager.all_steps(), reverse=True)
        damaged: list[InputError] = []
        for step in steps:
            try:
                with decoding_checkpoint(self.folder / str(step)):
                    _verify_checksums(self.folder / str(step))
                    state = self._manager.restore(step, args=ocp.args.StandardRestore(like))
            except InputError as error:
                damaged.append(error)
                continue
            if damaged:
                lost = steps[: len(damaged)]
                on_first_process(partial(self._set_aside, lost))
                self._manager.reload()
                warn(
                    f"{self.folder / str(steps[0])}: is damaged; training resumes from the "
                    f"checkpoint of step {step}, {steps[0] - step} steps are lost. Damaged "
                    f"checkpoints are now in {self.folder.parent / DAMAGED}"
                )
            return state
        raise damaged[0]

    def _set_aside(self, steps: list[int]) -> None:
        """Move checkpoints to another folder: Orbax writes no step before its latest one."""
        target = self.folder.parent / DAMAGED
        with writing_checkpoint(target):
            target.mkdir(exist_ok=True)
            for step in steps:
                free = target / str(step)
                while free.exists():
                    free = free.with_name(f"{free.name}_again")
                os.replace(self.folder / str(step), free)


def writing_checkpoint(folder: Path) -> AbstractContextManager[None]:
    """Turn any failure to write into an :class:`InputError`.

    Orbax and TensorStore report a full disk by various exceptions.
    """
    return _failures_as(CannotWriteError, folder)


def decoding_checkpoint(path: Path) -> AbstractContextManager[None]:
    """Turn any failure to read into an :class:`InputError`."""
    return _failures_as(_damaged, path)


def _damaged(path: Path, reason: str) -> InputError:
    """Return the error of a folder that cannot be used as a checkpoint."""
    return InputError(
        f"{path}: is not a complete checkpoint of this training ({reason}); train in another folder"
    )


@contextmanager
def _failures_as(error_of: Callable[[Path, str], InputError], folder: Path) -> Iterator[None]:
    """Raise failures as another error, and keep Orbax from logging that of each of its threads.

    These are hundreds of lines for a full disk. After a failure, errors about the folder are
    dropped until the end of the process: asyncio logs those of tasks when it removes them.
    """
    inside = True

    def is_new(record: logging.LogRecord) -> bool:
        repeated = inside or str(folder) in record.getMessage()
        return record.levelno < logging.ERROR or not repeated

    loggers = [logging.getLogger(name) for name in ("absl", "asyncio")]
    for logger in loggers:
        logger.addFilter(is_new)
    try:
        yield
        for logger in loggers:
            logger.removeFilter(is_new)
    except InputError:
        raise
    except Exception as error:
        raise error_of(folder, _reason(error)) from error
    finally:
        inside = False


def _reason(error: BaseException) -> str:
    """Return the cause of a failure in a few words."""
    text = f"{error} {error.__cause__ or ''}"
    for words in ("No space left on device", "Read-only file system", "Permission denied"):
        if words in text:
            return words.lower()
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    return type(error).__name__


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


def _checksums(checkpoint: Path) -> dict[str, str]:
    """Return the SHA-256 of each file of the state, by its path in the checkpoint."""
    checksums = {}
    for path in sorted(checkpoint.glob("default/**/*")):
        if path.is_file():
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            checksums[path.relative_to(checkpoint).as_posix()] = digest
    return checksums


def _write_checksums(checkpoint: Path) -> None:
    """Write the checksums of a new checkpoint: Orbax does not notice a changed array."""
    with writing_checkpoint(checkpoint), atomic_path(checkpoint / CHECKSUMS) as temporary:
        temporary.write_text(json.dumps(_checksums(checkpoint), indent=1), encoding="utf-8")


def _verify_checksums(checkpoint: Path) -> None:
    """Raise an error if the state differs from its checksums; older checkpoints have none."""
    path = checkpoint / CHECKSUMS
    if path.is_file() and json.loads(path.read_bytes()) != _checksums(checkpoint):
        raise _damaged(checkpoint, "its files have other checksums")


def _score(metrics: Mapping[str, float]) -> float:
    return metrics[SCORE_KEY]


def _remove_damaged_scores(folder: Path) -> None:
    """Remove scores that cannot be read: the manager would fail on them, and needs none."""
    for file in folder.glob("*/metrics/metrics"):
        try:
            float(_score(json.loads(file.read_bytes())))
        except (ValueError, KeyError, TypeError):
            with writing_checkpoint(folder):
                file.unlink()
            warn(f"{file}: is damaged and removed; the checkpoint counts as not validated")
