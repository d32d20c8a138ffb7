"""The command ``pool``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import AvoidSubcommands, Positional, arg

from occjax.data.photographs import load_photographs
from occjax.data.pool import pool_size, render_pool
from occjax.data.scene_config import TEXTURED, SceneConfig


def pool_command(
    folder: Positional[
        Annotated[Path, arg(metavar="FOLDER", help="The pool; one that is there is added to.")]
    ],
    count: Annotated[int, arg(help="Light fields that it shall have.")] = 2000,
    seed: Annotated[int, arg(help="Another seed, other light fields.")] = 0,
    photographs: Annotated[
        bool, arg(help="Photographs among the textures (needs scikit-image).")
    ] = True,
    scenes: AvoidSubcommands[SceneConfig] = TEXTURED,
) -> int:
    """Render procedural light fields once, to train on them many times."""
    textures = load_photographs() if photographs else None
    render_pool(folder, count, scenes, seed, photographs=textures)
    print(
        f"{folder}: {pool_size(folder)} light fields\n"
        "train on it with: occjax train RUN --data.procedural-share 0 "
        f"--data.pools {folder} --data.prepared PREPARED"
    )
    return 0
