"""``occjax render``: a function for tyro, registered by :mod:`occjax.cli`."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

from tqdm import tqdm
from tyro.conf import Positional, arg

from occjax.errors import InputError
from occjax.render.config import RenderConfig, Style
from occjax.render.rendering import find_blender, render_scene


def render_command(
    folder: Positional[
        Annotated[Path, arg(metavar="FOLDER", help="Scenes go to FOLDER/s<seed>/.")]
    ],
    seeds: Annotated[
        tuple[int, int],
        arg(metavar="FIRST END", help="One scene for each seed from FIRST to END - 1."),
    ] = (0, 1),
    size: Annotated[int, arg(help="Pixels on each side of a view.")] = 256,
    samples: Annotated[int, arg(help="Rays per pixel: less noise takes longer.")] = 32,
    style: Annotated[Style, arg(help="Kind of scene; mixed takes them in turn.")] = "mixed",
    grid: Annotated[tuple[int, int], arg(metavar="V U", help="Rows and columns of views.")] = (
        9,
        9,
    ),
    denoise: Annotated[
        bool, arg(help="Remove noise; what is made up differs between views.")
    ] = False,
    threads: Annotated[int, arg(help="Of the renderer; 0 for as many as there are cores.")] = 0,
    blender: Annotated[
        Path | None,
        arg(
            metavar="PYTHON",
            help="Python that has bpy, if not this one nor that in OCCJAX_BLENDER_PYTHON.",
            help_behavior_hint="",
        ),
    ] = None,
) -> int:
    """Render random scenes in Blender, with exact disparity; finished views are kept."""
    first, end = seeds
    if not 0 <= first < end:
        raise InputError(
            f"--seeds {first} {end} are no seeds; the second number is one past the last"
        )
    python = find_blender(blender)
    for seed in range(first, end):
        config = RenderConfig(
            seed=seed,
            style=style,
            image_size=(size, size),
            grid=grid,
            samples=samples,
            denoise=denoise,
        )
        target = folder / f"s{seed:03d}"
        begin = time.perf_counter()
        with tqdm(
            total=config.views, desc=target.name, unit="view", leave=False, disable=None
        ) as bar:

            def show(done: int, total: int, bar: tqdm = bar) -> None:
                bar.update(done - bar.n)

            render_scene(target, config, blender=python, threads=threads, progress=show)
        tqdm.write(f"{target}: {time.perf_counter() - begin:.0f} s", file=sys.stdout)
    return 0
