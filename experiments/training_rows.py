"""What experiments that train one network a row have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from occjax.training import Recipe, Scene, make_source, read_log, train
from occjax.training.checkpoints import CONFIG_FILE, read_description
from occjax.training.step import BatchSource

Scores = Mapping[str, Any]
"""A line of a training's log; scores have the names that :func:`occjax.training.validate` gives."""


def train_row(
    row: Recipe,
    place: Path,
    validation: Sequence[Scene],
    *,
    source: BatchSource | None = None,
    described: Mapping[str, Any] | None = None,
) -> Scores:
    """Train a row, go on with it where it was interrupted, or read it if it is done.

    Args:
        row: The training.
        place: Its folder.
        validation: Scenes to score.
        source: That of the row's data, where rows share one, so that it is made once.
        described: What must not have changed since the row was begun, beside what is trained.

    Returns:
        Scores at the end.

    Raises:
        InputError: If the folder holds another training, or the data cannot be used.
    """
    source = source or make_source(row.data, row.train.network)
    train(row.train, source, place, run=row.run, validation=validation, data=described)
    return [entry for entry in read_log(place) if entry["kind"] == "validation"][-1]


def scores_if_done(place: Path) -> Scores | None:
    """Scores of a row that is done, without any training.

    Args:
        place: Folder of a row.

    Returns:
        Scores after the last step, None if the row is not there or not done.
    """
    if not (place / CONFIG_FILE).is_file():
        return None
    steps = read_description(place)["steps"]
    entries = [entry for entry in read_log(place) if entry["kind"] == "validation"]
    return entries[-1] if entries and entries[-1]["step"] == steps else None


def slug(name: str) -> str:
    """A name as one of a folder."""
    return "".join(letter if letter.isalnum() else "_" for letter in name)
