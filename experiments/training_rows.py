"""Trainings of one network per table row, by the paper's recipe or by that of this library."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import jax
from tqdm import tqdm
from tyro.conf import arg

from experiments.command_line import Small, announce_smoke_test
from experiments.networks import Published, small_form
from experiments.published_training import published_recipe, published_source
from occjax.cli.options import option
from occjax.data.procedural import Defects, Outlines, SceneConfig, Textures
from occjax.data.scenes import load_scenes
from occjax.errors import InputError
from occjax.io.run_folder import read_description
from occjax.lightfield import LightField
from occjax.models import OccCasNetConfig
from occjax.training import (
    Recipe,
    make_source,
    read_log,
    recipe,
    scenes_from_folders,
    train,
)
from occjax.training.checkpoints import CONFIG_FILE
from occjax.training.data import validation_scenes
from occjax.training.step import BatchSource

R = TypeVar("R")

Scores = Mapping[str, Any]
"""Line of a training's log, with the score names of :func:`occjax.training.validate`."""

RecipeName = Literal["published", "full"]

VALIDATION_COUNT = 8
"""Number of procedural light fields to validate on, if no scenes are given."""


@dataclass(frozen=True)
class Row:
    """Training of one network.

    Attributes:
        network: Network to train.
        published: The paper's numbers; None if the paper has no such row.
        seed: Seed of the initial weights and the data.
    """

    network: OccCasNetConfig
    published: Published | None = None
    seed: int = 0


@dataclass(frozen=True)
class Training:
    """Training settings of all rows, as options of the command line."""

    data: Annotated[tuple[Path, ...], option("Scenes to train on, or folders.", "FOLDER...")] = ()
    validate: Annotated[tuple[Path, ...], option("Scenes with ground truth.", "SCENE...")] = ()
    recipe: Annotated[RecipeName, arg(help="Training recipe of each row.")] = "published"
    steps: Annotated[int | None, option("Steps of each row instead of the recipe's.", "INT")] = None
    show: Annotated[bool, arg(help="Show the finished rows without any training.")] = False
    small: Small = False

    def sized(self, rows: Mapping[str, Row]) -> dict[str, Row]:
        """Return the rows; for a smoke test with small networks."""
        if not self.small:
            return dict(rows)
        return {name: replace(row, network=small_form(row.network)) for name, row in rows.items()}

    def scores(self, rows: Mapping[str, Row], folder: Path) -> dict[str, Scores]:
        """Train the rows, or read the finished ones.

        Args:
            rows: Rows by name, see :meth:`sized`; all networks take the same grid of views.
            folder: Folder with one subfolder for each row.

        Returns:
            Scores by row.

        Raises:
            InputError: If data are missing or unusable, or a folder contains another training.
        """
        if self.show:
            found = {name: finished_scores(folder / name) for name in rows}
            return {name: scores for name, scores in found.items() if scores is not None}
        network = next(iter(rows.values())).network
        if self.small:
            announce_smoke_test()
            base, count = small_recipe(), 1
        else:
            base = base_recipe(self.recipe, data=self.data, steps=self.steps)
            count = VALIDATION_COUNT
        if self.validate:
            scenes = scenes_from_folders(self.validate)
        elif base.data.procedural_share == 0.0:
            raise InputError("there are no scenes to score; pass --validate SCENE...")
        else:
            scenes = validation_scenes(base.data, count)

        @cache
        def source(seed: int) -> BatchSource:
            if self.recipe == "full" or self.small:
                return make_source(replace(base.data, seed=seed), network)
            scenes = load_scenes(base.data.folders, views=network.views)
            return published_source(scenes, base.data.batch_size, seed)

        results = {}
        for name, row in rows.items():
            own = with_row(base, row)
            results[name] = train_row(
                own, folder / name, scenes, source=source(row.seed), described=asdict(own.data)
            )
        return results


def base_recipe(name: RecipeName, *, data: Sequence[Path] = (), steps: int | None = None) -> Recipe:
    """Return a recipe whose network is replaced later.

    Args:
        name: ``published`` for HCI scenes, ``full`` for procedural light fields.
        data: Folders of the scenes to train on.
        steps: Number of steps instead of the recipe's; the schedule of the learning rate shrinks
            in proportion.

    Returns:
        The recipe.

    Raises:
        InputError: If ``published`` has no scenes, or ``steps`` is less than 1.

    Example:
        >>> base_recipe("full", steps=100).train.optimiser.warm_up
        25
    """
    base = published_recipe() if name == "published" else recipe(name)
    if name == "published" and not data:
        raise InputError(
            "the published training needs the 16 additional scenes of the HCI benchmark: pass "
            "--data FOLDER, or --recipe full for procedural light fields"
        )
    base = replace(base, data=replace(base.data, folders=tuple(data)))
    return base if steps is None else _shortened(base, steps)


def small_recipe() -> Recipe:
    """Return two steps on small and simple procedural scenes."""
    base = _shortened(recipe("tiny"), 2)
    scenes = simple_scenes(base.data.scenes)
    return replace(base, data=replace(base.data, batch_size=2, scenes=scenes, augmentation=None))


def with_row(base: Recipe, row: Row) -> Recipe:
    """Return the recipe of a row.

    Args:
        base: Recipe with optimiser and data.
        row: Network and seed.

    Returns:
        The recipe; ``base`` decides what BatchNorm of the features computes its statistics over.
    """
    statistics = base.train.network.feature_statistics
    network = replace(row.network, feature_statistics=statistics)
    return replace(
        base,
        train=replace(base.train, network=network, seed=row.seed),
        data=replace(base.data, seed=row.seed),
    )


def train_row(
    row: Recipe,
    folder: Path,
    validation: Sequence[LightField],
    *,
    source: BatchSource | None = None,
    described: Mapping[str, Any] | None = None,
) -> Scores:
    """Train a row, resume an interrupted training, or read a finished one.

    Args:
        row: The training.
        folder: Folder of the row.
        validation: Scenes to score.
        source: Source of the row's batches, if several rows share one.
        described: Settings that must be the same when the training is resumed, in addition to
            those of the training itself.

    Returns:
        Scores after the last step.

    Raises:
        InputError: If the folder contains another training, or the data cannot be used.
    """
    train(
        row.train,
        source or make_source(row.data, row.train.network),
        folder,
        run=row.run,
        validation=validation,
        data=described,
        # Standard output is for the table.
        say=lambda line: tqdm.write(f"{folder.name}: {line}", file=sys.stderr),
    )
    # Each row compiles its own programs; twenty rows would exhaust a process's memory maps.
    jax.clear_caches()
    return [entry for entry in read_log(folder) if entry["kind"] == "validation"][-1]


def finished_scores(folder: Path) -> Scores | None:
    """Return the scores of a finished training; None if it is missing or unfinished."""
    if not (folder / CONFIG_FILE).is_file():
        return None
    steps = read_description(folder / CONFIG_FILE)["steps"]
    entries = [entry for entry in read_log(folder) if entry["kind"] == "validation"]
    return entries[-1] if entries and entries[-1]["step"] == steps else None


def select_rows(names: Sequence[str], rows: Mapping[str, R]) -> dict[str, R]:
    """Return the rows with the given names, in this order; all rows if there are no names.

    Raises:
        InputError: If there is no row of a name.

    Example:
        >>> select_rows(["b"], {"a": 1, "b": 2})
        {'b': 2}
    """
    for name in names:
        if name not in rows:
            raise InputError(f"there is no row named {name!r}; there are {', '.join(rows)}")
    return {name: rows[name] for name in names or rows}


def simple_scenes(scenes: SceneConfig) -> SceneConfig:
    """Return scenes with few ingredients, whose generator compiles fast."""
    return replace(
        scenes,
        walls=1,
        sheets=4,
        solids=0,
        texture_count=2,
        textures=first_only(Textures),
        outlines=first_only(Outlines),
        curved=0.0,
        shading=0.0,
        shadows=0.0,
        creases=0.0,
        highlights=0.0,
        reflections=0.0,
        defects=Defects(*[0.0] * len(fields(Defects))),
    )


def first_only(shares: type[R]) -> R:
    """Return a dataclass of shares whose first field is 1 and whose others are 0."""
    return shares(1.0, *[0.0] * (len(fields(shares)) - 1))


def slug(name: str) -> str:
    """Return a name as a valid folder name."""
    return "".join(letter if letter.isalnum() else "_" for letter in name)


def _shortened(base: Recipe, steps: int) -> Recipe:
    """Return a recipe of fewer steps whose learning rate schedule shrinks in proportion."""
    optimiser = base.train.optimiser
    optimiser = replace(
        optimiser,
        warm_up=min(optimiser.warm_up, steps // 4),
        epoch_steps=max(1, optimiser.epoch_steps * steps // base.train.steps),
    )
    return replace(base, train=replace(base.train, optimiser=optimiser, steps=steps))
