"""Pool of light fields with fewer views: small grids, and views on one side of the centre view.

    python -m experiments.view_subsets runs/subsets runs/a runs/b
    python -m experiments.view_subsets runs/subsets --small          (seconds)

The given pools have all 9x9 views. Cost: a minute for 360 light fields. Expected: a pool with about
two light fields for each of theirs, grids of 3x3 and 5x5 views, a quarter or a half of the 9x9
views around the centre view, or a row or column. ProposalNet that is trained on it as well is more
accurate on small grids and for views at the border (docs/notes/training.md).
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
import tyro

from experiments.command_line import Small, announce_smoke_test, main
from experiments.training_rows import simple_scenes
from occjax.cli.options import option
from occjax.data.pool import (
    DESCRIPTION,
    light_field_file,
    light_field_files,
    read_sample,
    render_pool,
    write_sample,
)
from occjax.data.procedural import SceneConfig
from occjax.data.samples import LightFieldSample
from occjax.errors import InputError
from occjax.io.run_folder import open_run_folder, read_description
from occjax.lightfield import view_offsets
from occjax.view_selection import select_view_indices

GRID = (9, 9)
"""Number of view rows and columns of the given pools."""


class Subset(NamedTuple):
    """A subset of the 9x9 views.

    Attributes:
        kind: A ``"grid"`` around the centre view; a ``"quarter"`` or ``"half"`` of the views, with
            the centre view at its corner or border; or the ``"line"`` of its row or column.
        size: Number of rows and columns of a grid.
        step: Distance of neighbouring views of a grid, in steps of the 9x9 views.
    """

    kind: Literal["grid", "quarter", "half", "line"]
    size: int = 9
    step: int = 1


def planned_subsets(count: int) -> list[tuple[int, Subset]]:
    """Return the subsets of the views of a number of light fields, with the index of each."""
    planned = []
    for index in range(count):
        if index % 2 == 0:
            planned.append((index, Subset("grid", 3, step=(1, 2, 4)[index // 2 % 3])))
        if index % 3 == 0:
            planned.append((index, Subset("grid", 5, step=(1, 2)[index // 3 % 2])))
        if index % 2 == 1:
            planned.append((index, Subset("quarter")))
            planned.append((index, Subset("half" if index % 4 == 1 else "line")))
    return planned


def draw_subset(
    generator: np.random.Generator, sample: LightFieldSample, subset: Subset
) -> LightFieldSample:
    """Return a light field with a subset of its views.

    Args:
        generator: Random generator; draws the side of a quarter or half, or the line.
        sample: Light field of 9x9 views, as NumPy arrays.
        subset: The subset; its step is the view step of the result.

    Returns:
        Views ``[1, n, h, w]``: the two outermost of the subset in each of the eight directions.
    """
    step = subset.step
    offsets = view_offsets(*GRID).reshape(-1, 2)
    if subset.kind == "grid":
        radius = step * (subset.size // 2)
        inside = ((offsets % step == 0) & (np.abs(offsets) <= radius)).all(axis=1)
    elif subset.kind == "quarter":
        inside = (offsets * generator.choice([-1, 1], 2) >= 0).all(axis=1)
    elif subset.kind == "half":
        axis = generator.integers(2)
        inside = offsets[:, axis] * generator.choice([-1, 1]) >= 0
    else:
        inside = offsets[:, generator.integers(2)] == 0
    indices = np.flatnonzero(inside)
    indices = indices[select_view_indices(offsets[indices], "outer_star")]

    def selected(maps: np.ndarray) -> np.ndarray:
        return maps.reshape(-1, *maps.shape[2:])[None, indices]

    return sample._replace(
        views=selected(sample.views),
        offsets=selected(sample.offsets) / step,
        disparity=sample.disparity * step,
        visibility=selected(sample.visibility),
    )


def run(
    folder: Annotated[tyro.conf.Positional[Path], option("Pool to write.")],
    pools: Annotated[
        tyro.conf.Positional[tuple[Path, ...]], option("Pools of 9x9 views, by occjax pool.")
    ] = (),
    *,
    seed: Annotated[int, option("Seed of the order and of the sides.")] = 0,
    small: Small = False,
) -> None:
    """Write the pool."""
    if small == bool(pools):
        raise InputError("pass pools of 9x9 views, or pass --small alone")
    if small:
        announce_smoke_test()
        pools = (folder / "9x9",)
        folder = folder / "subsets"
        scenes = SceneConfig(image_size=(32, 32), views="all")
        render_pool(pools[0], 2, simple_scenes(scenes), seed)
    files = [file for pool in pools for file in light_field_files(pool)]
    if read_sample(files[0]).offsets.shape[:2] != GRID:
        raise InputError(f"{files[0]}: not 9x9 views; render the pool with --scenes.views all")
    descriptions = [read_description(pool / DESCRIPTION) for pool in pools]
    description = {"seed": seed, "files": len(files), "pools": descriptions}
    open_run_folder(folder, DESCRIPTION, description, contents="a pool")
    generator = np.random.default_rng(seed)
    planned = planned_subsets(len(files))
    for number, index in enumerate(generator.permutation(len(planned))):
        light_field, subset = planned[index]
        sample = draw_subset(generator, read_sample(files[light_field]), subset)
        write_sample(light_field_file(folder, number), sample)
    print(f"{folder}: {len(planned)} light fields with fewer views")


if __name__ == "__main__":
    main(run, __doc__)
