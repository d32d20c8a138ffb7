"""The command ``pool``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import AvoidSubcommands, Positional, arg

from occjax.data.procedural import TEXTURED, SceneConfig


def pool_command(
    folder: Annotated[
        Path, Positional, arg(metavar="FOLDER", help="The pool; an existing pool is enlarged.")
    ],
    count: Annotated[int, arg(help="Number of light fields that the pool should have.")] = 2000,
    seed: Annotated[int, arg(help="Seed of the light fields.")] = 0,
    scenes: AvoidSubcommands[SceneConfig] = TEXTURED,
) -> int:
    """Render procedural light fields once, to train on them many times."""
    from occjax.data.pool import light_field_files, render_pool

    render_pool(folder, count, scenes, seed)
    print(
        f"{folder}: {len(light_field_files(folder))} light fields\n"
        "train on it with: occjax train RUN --data.procedural-share 0 "
        f"--data.pools {folder} --data.prepared PREPARED"
    )
    return 0
