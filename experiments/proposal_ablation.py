"""Ablation of the proposal network, its loss and its training data.

    python -m experiments.proposal_ablation runs/ablation --validate SCENE...
    python -m experiments.proposal_ablation FOLDER --small            (minutes)

Cost: five minutes a row on two cores. Finished rows are kept, and an interrupted row resumes.
Expected: the table in docs/notes/training.md. Every row is one change to the same short training on
small patches; a change to the light fields has its own pool. The first rows differ only in their
seed: smaller differences than between them are not significant.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from experiments.command_line import Small, announce_smoke_test, main
from experiments.markdown import markdown_table
from experiments.training_rows import first_only, select_rows, simple_scenes, slug, train_row
from occjax.cli.options import option
from occjax.data.pool import render_pool
from occjax.data.procedural import Defects, Outlines, Textures
from occjax.lightfield import LightField
from occjax.models import ProposalNetConfig, preset
from occjax.training import Recipe, RunConfig, recipe, scenes_from_folders
from occjax.training.data import validation_scenes

Change = Callable[[Recipe], Recipe]


@dataclass(frozen=True)
class Scale:
    """Size of the trainings.

    Attributes:
        steps: Number of steps.
        pool: Number of light fields.
        patch: Side of a patch, in pixels.
        batch: Patches in a step.
        held_out: Number of procedural light fields of the unchanged kind to validate on.
        preset: Network that the rows change.
        simple: Use light fields with few ingredients.
    """

    steps: int = 400
    pool: int = 300
    patch: int = 64
    batch: int = 4
    held_out: int = 8
    preset: str = "proposal"
    simple: bool = False


SMALL = Scale(steps=2, pool=2, patch=32, batch=2, held_out=1, preset="proposal_small", simple=True)


def scenes(**changes: Any) -> Change:
    """Return a change of the light fields' distribution."""
    return lambda base: replace(
        base, data=replace(base.data, scenes=replace(base.data.scenes, **changes))
    )


def loss(**changes: Any) -> Change:
    """Return a change of the loss."""
    return lambda base: replace(
        base, train=replace(base.train, loss=replace(base.train.loss, **changes))
    )


def network(part: str, **changes: Any) -> Change:
    """Return a change of one part of the network's configuration."""

    def change(base: Recipe) -> Recipe:
        config = base.train.network
        changed = replace(config, **{part: replace(getattr(config, part), **changes)})
        return replace(base, train=replace(base.train, network=changed))

    return change


def other_network(name: str) -> Change:
    """Return a change to the network of a preset."""
    return lambda base: replace(base, train=replace(base.train, network=preset(name)))


def seed(number: int) -> Change:
    """Return a change of the initial weights and of the order of the light fields."""
    return lambda base: replace(
        base, train=replace(base.train, seed=number), data=replace(base.data, seed=number)
    )


_STRAIGHT = ((-4, 0), (4, 0), (0, -4), (0, 4))
_EVEN_LIGHT = {"shading": 0.0, "shadows": 0.0, "creases": 0.0}

ROWS: Mapping[str, Change] = {
    "unchanged": lambda base: base,
    "another seed": seed(1),
    "a third seed": seed(2),
    # Light fields
    "noise as the only texture": scenes(textures=first_only(Textures)),
    "no weak or missing texture": scenes(low_contrast=0.0, textureless=0.0, calm=0.0, similar=0.0),
    "no highlights, no reflections": scenes(highlights=0.0, reflections=0.0),
    "no shading, shadows, creases": scenes(**_EVEN_LIGHT),
    "fronto-parallel walls, nothing curved": scenes(slanted=0.0, curved=0.0),
    "no thin objects": scenes(outlines=replace(Outlines(), grids=0.0, wires=0.0, leaves=0.0)),
    "no camera defects": scenes(defects=Defects(*[0.0] * len(dataclasses.fields(Defects)))),
    "one ray per pixel": scenes(rays=1),
    # Loss
    "L1 loss": loss(penalty="l1"),
    "no distribution loss": loss(distribution=0.0),
    "equal weight of all pixels": loss(settled=1.0),
    # Network
    "no plane steps before the selection": network("refinement", steps=0),
    "four neighbours": network("proposals", offsets=_STRAIGHT),
    "near neighbours": network(
        "proposals",
        offsets=(*((-3, 0), (3, 0), (0, -3), (0, 3)), *((-5, -5), (-5, 5), (5, -5), (5, 5))),
    ),
    "the small network": other_network("proposal_small"),
    "the large network": other_network("proposal_large"),
    "a selector with a small receptive field": network("selector", context=(48,)),
}
"""Changes to the training, one per row."""


def base_recipe(scale: Scale) -> Recipe:
    """Return the recipe of the proposal network, shortened for the ablation."""
    full = recipe("proposal")
    size = scale.patch
    scenes = replace(full.data.scenes, image_size=(size + 8, size + 8))
    optimiser = replace(full.train.optimiser, warm_up=min(50, scale.steps // 4))
    return replace(
        full,
        train=replace(
            full.train, network=preset(scale.preset), optimiser=optimiser, steps=scale.steps
        ),
        data=replace(
            full.data,
            batch_size=scale.batch,
            procedural_share=0.0,
            scenes=simple_scenes(scenes) if scale.simple else scenes,
            augmentation=full.data.augmentation
            and replace(full.data.augmentation, crop=(size, size)),
        ),
    )


def run_row(
    name: str, folder: Path, scale: Scale, validation: Sequence[LightField]
) -> Mapping[str, float]:
    """Train one row, or read its scores if it is finished.

    Args:
        name: One of :data:`ROWS`.
        folder: Folder of the ablation.
        scale: Size of the trainings.
        validation: Scenes to score.

    Returns:
        Scores with the names of :func:`occjax.training.validate`.
    """
    base = base_recipe(scale)
    row = ROWS[name](base)
    same_scenes = row.data.scenes == base.data.scenes
    pool = folder / "pools" / slug("unchanged" if same_scenes else name)
    render_pool(pool, scale.pool, row.data.scenes, base.data.seed)
    # Rows with the same pool and the same proposals share the prepared light fields.
    same_proposals = _proposals_of(row) == _proposals_of(base)
    kept = slug(pool.name if same_proposals else name)
    data = replace(row.data, pools=(pool,), prepared=folder / "prepared" / kept)
    run = RunConfig(validate_every=scale.steps, log_every=50)
    return train_row(replace(row, data=data, run=run), folder / slug(name), validation)


def table(results: Mapping[str, Mapping[str, float]], groups: Mapping[str, list[str]]) -> str:
    """Return the mean MSE and BadPix of each group of scenes, as Markdown.

    Args:
        results: Scores by row.
        groups: Names of the scenes by group.
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
        tyro.conf.Positional[Path], tyro.conf.arg(metavar="FOLDER", help="Folder of all trainings.")
    ],
    validate: Annotated[
        tuple[Path, ...],
        option("Scenes with ground truth; the table averages each folder.", "SCENE..."),
    ] = (),
    rows: Annotated[tuple[str, ...], option("Rows to train; by default all.", "ROW...")] = (),
    small: Small = False,
) -> dict[str, Mapping[str, float]]:
    """Train the rows, print the table and return the scores by row."""
    scale = SMALL if small else Scale()
    base = base_recipe(scale)
    names = select_rows(rows, ROWS)
    if small:
        announce_smoke_test()
    held_out = validation_scenes(base.data, scale.held_out)
    given = scenes_from_folders(validate)
    results = {}
    for name in names:
        results[name] = run_row(name, folder, scale, [*held_out, *given])
    groups = {"procedural": [scene.name for scene in held_out]}
    for place, scene in zip(validate, given, strict=True):
        groups.setdefault(place.resolve().parent.name, []).append(scene.name)
    print(table(results, groups))
    return results


def _proposals_of(row: Recipe) -> tuple[ProposalNetConfig, int]:
    """Return the settings that the prepared proposals depend on."""
    return replace(row.train.network, selector=None, residual=None), row.data.seed


if __name__ == "__main__":
    main(run, __doc__)
