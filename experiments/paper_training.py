"""Trainings that differ in their network, by the paper's recipe or that of this library."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from experiments.networks import Published, small_form
from experiments.training_rows import Scores, scores_if_done, simple_scenes, train_row
from occjax.cli.options import option
from occjax.errors import InputError
from occjax.models import NetworkConfig
from occjax.training import Recipe, Scene, make_source, recipe, scenes_from_folders
from occjax.training.data import validation_scenes

RecipeName = Literal["published", "full"]

HELD_OUT = 8
"""Procedural light fields to score on, if no scenes are given."""


@dataclass(frozen=True)
class Row:
    """One training.

    Attributes:
        network: What is trained.
        published: The paper's row; none if it has no such row.
        seed: Of first weights and data.
    """

    network: NetworkConfig
    published: Published | None = None
    seed: int = 0


@dataclass(frozen=True)
class Training:
    """How rows are trained, as options of the command line."""

    data: Annotated[tuple[Path, ...], option("Scenes to train on, or folders.", "FOLDER...")] = ()
    validate: Annotated[tuple[Path, ...], option("Scenes with ground truth.", "SCENE...")] = ()
    recipe: Annotated[RecipeName, arg(help="How each row is trained.")] = "published"
    steps: Annotated[int | None, option("Steps of each row in place of the recipe's.", "INT")] = (
        None
    )
    show: Annotated[bool, arg(help="Train nothing, show the rows that are done.")] = False
    small: Annotated[bool, arg(help="Two steps of small networks, and small views.")] = False

    def sized(self, rows: Mapping[str, Row]) -> dict[str, Row]:
        """The rows with their networks, or with small ones."""
        return {name: small_row(row) if self.small else row for name, row in rows.items()}

    def scores(self, rows: Mapping[str, Row], folder: Path) -> dict[str, Scores]:
        """Train the rows, or read those that are done.

        Args:
            rows: By name, see :meth:`sized`.
            folder: In which each row has a folder of its name.

        Returns:
            Scores by row.

        Raises:
            InputError: If data are missing or cannot be used, or a folder holds something else.
        """
        if self.show:
            return done_rows(folder, rows)
        if self.small:
            base, held_out = small_recipe(), 1
        else:
            base, held_out = base_recipe(self.recipe, data=self.data, steps=self.steps), HELD_OUT
        scenes = scenes_to_score(base, self.validate, rows, held_out=held_out)
        return train_rows(base, rows, folder, scenes)


def base_recipe(name: RecipeName, *, data: Sequence[Path] = (), steps: int | None = None) -> Recipe:
    """A training whose network is yet to be chosen.

    Args:
        name: ``published`` on HCI scenes, or ``full`` on procedural light fields.
        data: Folders of the scenes to train on.
        steps: Number of steps in place of the recipe's.

    Returns:
        The recipe.

    Raises:
        InputError: If ``published`` has no scenes, or there are no steps.

    Example:
        >>> base_recipe("full", steps=100).train.optimiser.warm_up
        25
    """
    base = recipe(name)
    if name == "published" and not data:
        raise InputError(
            "the published training needs the 16 additional scenes of the HCI benchmark: pass "
            "--data FOLDER, or --recipe full for procedural light fields"
        )
    base = replace(base, data=replace(base.data, folders=tuple(data)))
    return base if steps is None else _shortened(base, steps)


def small_recipe() -> Recipe:
    """Two steps on small and simple procedural scenes."""
    base = _shortened(recipe("tiny"), 2)
    data = replace(
        base.data, batch_size=1, scenes=simple_scenes(base.data.scenes), augmentation=None
    )
    return replace(base, data=data)


def small_row(row: Row) -> Row:
    """A row with a network of 3x3 views and few channels."""
    return replace(row, network=small_form(row.network))


def with_row(base: Recipe, row: Row) -> Recipe:
    """The training of a row.

    Args:
        base: Optimiser and data.
        row: Network and seed.

    Returns:
        The recipe; BatchNorm takes its statistics over what it does in ``base``.
    """
    statistics = base.train.network.feature_statistics
    network = replace(row.network, feature_statistics=statistics)
    return replace(
        base,
        train=replace(base.train, network=network, seed=row.seed),
        data=replace(base.data, seed=row.seed),
    )


def train_rows(
    base: Recipe, rows: Mapping[str, Row], folder: Path, validation: Sequence[Scene]
) -> dict[str, Scores]:
    """Train each row in its own folder; those that are done are read, others gone on with.

    Args:
        base: Optimiser and data.
        rows: By name; all networks take the same grid of views.
        folder: In which each row has a folder of its name.
        validation: Scenes to score.

    Returns:
        Scores by row.

    Raises:
        InputError: If a folder holds another training, or the data cannot be used.
    """

    @cache
    def source(seed: int):
        network = next(iter(rows.values())).network
        return make_source(replace(base.data, seed=seed), network)

    results = {}
    for name, row in rows.items():
        training = with_row(base, row)
        results[name] = train_row(
            training,
            folder / name,
            validation,
            source=source(row.seed),
            described=asdict(training.data),
        )
    return results


def done_rows(folder: Path, names: Iterable[str]) -> dict[str, Scores]:
    """Scores of the rows that are done, without any training.

    Args:
        folder: Of :func:`train_rows`.
        names: Which rows.

    Returns:
        Scores by row, those only that are done.
    """
    found = {name: scores_if_done(folder / name) for name in names}
    return {name: scores for name, scores in found.items() if scores is not None}


def scenes_to_score(
    base: Recipe, folders: Sequence[Path], rows: Mapping[str, Row], *, held_out: int
) -> list[Scene]:
    """Scenes of the given folders, or procedural ones that training never sees.

    Args:
        base: The training.
        folders: Scenes with ground truth.
        rows: Whose networks take all views of one grid.
        held_out: Number of procedural ones, if no folders are given.

    Returns:
        The scenes.

    Raises:
        InputError: If a training on folders has none to be scored on, or one cannot be read.
    """
    if folders:
        network = next(iter(rows.values())).network
        return scenes_from_folders(folders, replace(base.train, network=network))
    if base.data.procedural_share == 0.0:
        raise InputError("there is nothing to score: pass --validate SCENE... with ground truth")
    return validation_scenes(base.data, held_out)


def _shortened(base: Recipe, steps: int) -> Recipe:
    """Fewer steps, with warm-up and halving of the learning rate in proportion."""
    optimiser = base.train.optimiser
    optimiser = replace(
        optimiser,
        warm_up=min(optimiser.warm_up, steps // 4),
        epoch_steps=max(1, optimiser.epoch_steps * steps // base.train.steps),
    )
    return replace(base, train=replace(base.train, optimiser=optimiser, steps=steps))
