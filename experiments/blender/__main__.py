"""Render random scenes in Blender, with exact disparity.

    python -m experiments.blender FOLDER --seeds 0 8
    python -m experiments.blender FOLDER --seeds 0 8 --blender PYTHON

Cost: about seven minutes a scene of 9x9 views of 256x256 pixels on two cores. Expected: a folder
``FOLDER/s<seed>`` for each seed from the first to the one before the last, in the layout of the HCI
4D benchmark: 81 views, disparity, depth, camera parameters and masks of regions. If a folder
already contains views of the same scene, only the missing ones are rendered. Blender is the Python
package ``bpy``; install it in an environment of its own and pass the interpreter.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

from tqdm import tqdm
from tyro.conf import Positional, arg

from experiments.blender.config import RenderConfig, Style
from experiments.blender.rendering import find_blender, render_scene
from experiments.command_line import main
from occjax.errors import InputError


def run(
    folder: Positional[Annotated[Path, arg(metavar="FOLDER", help="Folder for the scenes.")]],
    seeds: Annotated[
        tuple[int, int], arg(metavar="FIRST END", help="Render the seeds from FIRST to END - 1.")
    ] = (0, 1),
    size: Annotated[int, arg(help="Height and width of a view, in pixels.")] = 256,
    samples: Annotated[int, arg(help="Rays per pixel; more rays give less noise.")] = 32,
    style: Annotated[Style, arg(help="Kind of scene; mixed alternates between them.")] = "mixed",
    grid: Annotated[tuple[int, int], arg(metavar="V U", help="View rows and columns.")] = (9, 9),
    threads: Annotated[int, arg(help="Threads of the renderer; 0 for one per core.")] = 0,
    blender: Annotated[
        Path | None,
        arg(
            metavar="PYTHON",
            help="Python interpreter that has bpy; by default that of the variable "
            "OCCJAX_BLENDER_PYTHON, or else this one.",
        ),
    ] = None,
) -> None:
    """Render one scene for each seed."""
    first, end = seeds
    if not 0 <= first < end:
        raise InputError(f"--seeds {first} {end}: is an empty range; END is one past the last seed")
    python = find_blender(blender)
    for seed in range(first, end):
        config = RenderConfig(seed, style, (size, size), grid, samples)
        target = folder / f"s{seed:03d}"
        begin = time.perf_counter()
        with tqdm(
            total=config.views, desc=target.name, unit="view", leave=False, disable=None
        ) as bar:
            render_scene(
                target,
                config,
                blender=python,
                threads=threads,
                progress=lambda done, total, bar=bar: bar.update(done - bar.n),
            )
        print(f"{target}: {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main(run, __doc__)
