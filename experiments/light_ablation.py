"""What matters in the light network, its loss and the light fields it is trained on.

    python -m experiments.light_ablation runs/ablation --validate SCENE...
    python -m experiments.light_ablation FOLDER --small            (minutes, for the test)

Every row is one change to the same short training on small patches, with its own pool of light
fields where the change is to them. The first rows differ in the seed alone: smaller differences
than theirs mean nothing. Cost: about five minutes a row on two cores; rows that are
done are kept, and one that was interrupted goes on.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from experiments.command_line import main
from experiments.markdown import markdown_table
from experiments.training_rows import chosen, simple_scenes, slug, train_row
from occjax.cli.options import option
from occjax.data.photographs import load_photographs
from occjax.data.pool import render_pool
from occjax.data.scene_config import Defects, Outlines, Textures
from occjax.models import Choice, preset
from occjax.training import Recipe, RunConfig, Scene, recipe, scenes_from_folders
from occjax.training.data import validation_scenes

Change = Callable[[Recipe], Recipe]


@dataclass(frozen=True)
class Scale:
    """How large the trainings are.

    Attributes:
        steps: Steps of each.
        pool: Light fields of each.
        patch: Side of their patches, in pixels.
        batch: Patches in a step.
        held_out: Procedural light fields of the unchanged kind to validate on.
        preset: The network that is changed.
        simple: Whether light fields have few ingredients, and rows may not differ in them.
    """

    steps: int = 400
    pool: int = 300
    patch: int = 64
    batch: int = 4
    held_out: int = 8
    preset: str = "light"
    simple: bool = False


SMALL = Scale(steps=2, pool=2, patch=32, batch=1, held_out=1, preset="light_small", simple=True)


def scenes(**changes: Any) -> Change:
    """Change the distribution of the light fields."""
    return lambda base: replace(
        base, data=replace(base.data, scenes=replace(base.data.scenes, **changes))
    )


def loss(**changes: Any) -> Change:
    """Change what is minimised."""
    return lambda base: replace(
        base, train=replace(base.train, loss=replace(base.train.loss, **changes))
    )


def network(**changes: Any) -> Change:
    """Change the network as a whole."""
    return lambda base: replace(
        base, train=replace(base.train, network=replace(base.train.network, **changes))
    )


def choice(**changes: Any) -> Change:
    """Change the network's second stage."""

    def change(base: Recipe) -> Recipe:
        search, second = base.train.network.stages
        return network(stages=(search, replace(second, **changes)))(base)

    return change


def seed(number: int) -> Change:
    """Other first weights, another order of the light fields."""
    return lambda base: replace(
        base, train=replace(base.train, seed=number), data=replace(base.data, seed=number)
    )


_STRAIGHT = ((-4, 0), (4, 0), (0, -4), (0, 4))
_EVEN_LIGHT = {"shading": 0.0, "shadows": 0.0, "creases": 0.0}

ROWS: Mapping[str, Change] = {
    "as it is": lambda base: base,
    "another seed": seed(1),
    "a third seed": seed(2),
    # Light fields
    "no photographs": scenes(photographs=0.0),
    "noise as the only texture": scenes(
        photographs=0.0, textures=Textures(1.0, *[0.0] * (len(dataclasses.fields(Textures)) - 1))
    ),
    "no weak or missing texture": scenes(low_contrast=0.0, textureless=0.0, calm=0.0, similar=0.0),
    "no highlights, no reflections": scenes(highlights=0.0, reflections=0.0),
    "no shading, shadows, creases": scenes(**_EVEN_LIGHT),
    "fronto-parallel walls, nothing bent": scenes(slanted=0.0, curved=0.0),
    "no thin things": scenes(outlines=replace(Outlines(), grids=0.0, wires=0.0, leaves=0.0)),
    "no faults of the camera": scenes(defects=Defects(*[0.0] * len(dataclasses.fields(Defects)))),
    "one ray per pixel": scenes(rays=1),
    # Loss
    "L1 loss": loss(penalty="l1"),
    "no distribution loss": loss(distribution=0.0),
    "all pixels count alike": loss(settled=1.0),
    # Network
    "no plane steps before the choice": choice(plane_steps=0),
    "four neighbours": choice(neighbours=_STRAIGHT),
    "near neighbours": choice(
        neighbours=(*((-3, 0), (3, 0), (0, -3), (0, 3)), *((-5, -5), (-5, 5), (5, -5), (5, 5)))
    ),
    "the small network": network(stages=preset("light_small").stages),
    "the large network": network(stages=preset("light_large").stages),
    "a choice that sees little around": choice(aggregation=Choice(32, (48,))),
}
"""Changes to the training, one at a time."""


def base_recipe(scale: Scale) -> Recipe:
    """The light recipe, as short as the ablation needs it."""
    light = recipe("light")
    size = scale.patch
    scenes = replace(light.data.scenes, image_size=(size + 8, size + 8))
    optimiser = replace(light.train.optimiser, warm_up=min(50, scale.steps // 4))
    return replace(
        light,
        train=replace(
            light.train, network=preset(scale.preset), optimiser=optimiser, steps=scale.steps
        ),
        data=replace(
            light.data,
            batch_size=scale.batch,
            procedural_share=0.0,
            photographs=not scale.simple,
            scenes=simple_scenes(scenes) if scale.simple else scenes,
            augmentation=light.data.augmentation
            and replace(light.data.augmentation, crop=(size, size)),
        ),
    )


def run_row(
    name: str, folder: Path, scale: Scale, validation: Sequence[Scene]
) -> Mapping[str, float]:
    """Train one row, unless it is done, and read its scores.

    Args:
        name: One of :data:`ROWS`.
        folder: Of the whole ablation.
        scale: How large the trainings are.
        validation: Scenes to score.

    Returns:
        Scores as :func:`occjax.training.validate` names them.
    """
    base = base_recipe(scale)
    row = ROWS[name](base)
    same_scenes = row.data.scenes == base.data.scenes
    pool = folder / "pools" / slug("as it is" if same_scenes else name)
    photographs = load_photographs() if row.data.scenes.photographs > 0.0 else None
    render_pool(pool, scale.pool, row.data.scenes, base.data.seed, photographs=photographs)
    # Rows of one pool and the same proposals share what is prepared.
    same_proposals = _proposing(row) == _proposing(base)
    kept = slug(pool.name if same_proposals else name)
    data = replace(row.data, pools=(pool,), prepared=folder / "prepared" / kept)
    run = RunConfig(validate_every=scale.steps, log_every=50)
    return train_row(replace(row, data=data, run=run), folder / slug(name), validation)


def table(results: Mapping[str, Mapping[str, float]], groups: Mapping[str, list[str]]) -> str:
    """Mean MSE and BadPix of each group of scenes, as Markdown.

    Args:
        results: Scores by row.
        groups: Names of the scenes in each group.

    Returns:
        The table, with a line feed between its lines.
    """
    measures = ("mse_x100", "badpix_0.07", "badpix_0.03")
    head = [f"{group}: MSE x100 / 0.07 / 0.03" for group in groups]
    rows = [
        [
            name,
            *(
                " / ".join(
                    f"{np.mean([scores[f'{scene}/{measure}'] for scene in names]):.1f}"
                    for measure in measures
                )
                for names in groups.values()
            ),
        ]
        for name, scores in results.items()
    ]
    return markdown_table(["training", *head], rows)


def run(
    folder: Annotated[
        tyro.conf.Positional[Path], tyro.conf.arg(metavar="FOLDER", help="Of all trainings.")
    ],
    validate: Annotated[
        tuple[Path, ...],
        option("Scenes with ground truth; those of one folder are averaged.", "SCENE..."),
    ] = (),
    rows: Annotated[tuple[str, ...], option("Which rows; all by default.", "ROW...")] = (),
    small: Annotated[bool, tyro.conf.arg(help="Two steps of a small network.")] = False,
) -> dict[str, Mapping[str, float]]:
    """Train every row, print the table and return the scores by row."""
    scale = SMALL if small else Scale()
    base = base_recipe(scale)
    names = chosen(rows, ROWS)
    held_out = validation_scenes(base.data, scale.held_out)
    given = scenes_from_folders(validate, base.train, views=base.data.scenes.views)
    results = {}
    for name in names:
        results[name] = run_row(name, folder, scale, [*held_out, *given])
    groups = {"procedural": [scene.name for scene in held_out]}
    for place, scene in zip(validate, given, strict=True):
        groups.setdefault(place.resolve().parent.name, []).append(scene.name)
    print(table(results, groups))
    return results


def _proposing(row: Recipe) -> tuple:
    """What light fields are prepared by."""
    search, second = row.train.network.stages
    return search, second.plane_steps, second.neighbours, row.data.seed


if __name__ == "__main__":
    main(run, __doc__)
