"""What experiments that train one network a row have in common."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

import jax
from tqdm import tqdm

from occjax.data.scene_config import Defects, Outlines, SceneConfig, Textures
from occjax.errors import InputError
from occjax.io.claims import read_description
from occjax.training import Recipe, Scene, make_source, read_log, train
from occjax.training.checkpoints import CONFIG_FILE
from occjax.training.step import BatchSource

R = TypeVar("R")

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
    train(
        row.train,
        source,
        place,
        run=row.run,
        validation=validation,
        data=described,
        # Standard output is for the table.
        say=lambda line: tqdm.write(f"{place.name}: {line}", file=sys.stderr),
    )
    # The next row has programs of its own, and those of twenty use up a process's memory maps.
    jax.clear_caches()
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
    steps = read_description(place / CONFIG_FILE)["steps"]
    entries = [entry for entry in read_log(place) if entry["kind"] == "validation"]
    return entries[-1] if entries and entries[-1]["step"] == steps else None


def chosen(names: Sequence[str], rows: Mapping[str, R]) -> dict[str, R]:
    """Some of the rows.

    Args:
        names: Which; all if there are none.
        rows: By name.

    Returns:
        Those rows, in the order of the names.

    Raises:
        InputError: If there is no row of a name.

    Example:
        >>> chosen(["b"], {"a": 1, "b": 2})
        {'b': 2}
    """
    for name in names:
        if name not in rows:
            raise InputError(f"there is no row named {name!r}; there are {', '.join(rows)}")
    return {name: rows[name] for name in names or rows}


def simple_scenes(scenes: SceneConfig) -> SceneConfig:
    """Scenes of few ingredients: what they are made of decides how long they take to compile."""
    return replace(
        scenes,
        walls=1,
        sheets=4,
        solids=0,
        texture_count=2,
        textures=Textures(1.0, *[0.0] * (len(fields(Textures)) - 1)),
        outlines=Outlines(1.0, *[0.0] * (len(fields(Outlines)) - 1)),
        photographs=0.0,
        curved=0.0,
        shading=0.0,
        shadows=0.0,
        creases=0.0,
        highlights=0.0,
        reflections=0.0,
        defects=Defects(*[0.0] * len(fields(Defects))),
    )


def slug(name: str) -> str:
    """A name as one of a folder."""
    return "".join(letter if letter.isalnum() else "_" for letter in name)
