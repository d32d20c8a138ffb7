"""Render one scene: ``python -m kit JOB``, with the job as JSON.

The program writes ``geometry.npz`` and ``scene.json`` first, then the missing views. After each
view it prints ``view NNN``; the output of Blender itself is suppressed.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np


def main() -> None:
    """Render the job that the command line gives."""
    report = os.fdopen(os.dup(1), "w")
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)  # Blender prints from C, not through sys.stdout
    render(json.loads(sys.argv[1]), lambda line: print(line, file=report, flush=True))


def render(job: dict[str, Any], say) -> None:
    """Create the missing files in the folder of a job.

    Args:
        job: ``folder``, ``views`` (numbers of the views to render), ``threads``, and ``config``
            with seed, style, image_size, grid and samples.
        say: Called with a message after each view.
    """
    from .camera import Camera
    from .geometry import Rig, fit_rig
    from .scene import make_scene
    from .stage import build

    folder, config = Path(job["folder"]), job["config"]
    scene = make_scene(config["seed"], config["style"])
    build(scene)
    camera = Camera(scene, tuple(config["image_size"]), job["threads"])
    record = folder / "scene.json"
    if not record.exists():
        maps = camera.measure()
        rig = fit_rig(maps["depth"], scene.disparity_range, scene.lens_mm)
        _replace(folder / "geometry.npz", lambda path: _save(path, maps))
        facts = {
            "config": config,
            "style": scene.style,
            "rig": rig._asdict(),
            "exposure": camera.expose(),
            "plain": [k for k, part in enumerate(scene.parts, 1) if part.surface.plain],
            "glossy": [k for k, part in enumerate(scene.parts, 1) if part.surface.glossy],
        }
        _replace(record, lambda path: path.write_text(json.dumps(facts, indent=1)))
    facts = json.loads(record.read_text())
    rows, columns = config["grid"]
    for number in job["views"]:
        v, u = divmod(number, columns)
        camera.take(
            folder / f"input_Cam{number:03d}.png",
            Rig(**facts["rig"]),
            (v - rows // 2, u - columns // 2),
            samples=config["samples"],
            exposure=facts["exposure"],
            seed=config["seed"] * rows * columns + number,
        )
        say(f"view {number}")


def _replace(path: Path, write) -> None:
    """Write a file atomically."""
    temporary = path.with_name(f".{path.name}")
    write(temporary)
    os.replace(temporary, path)


def _save(path: Path, maps: dict[str, np.ndarray]) -> None:
    """Write an ``.npz`` file to exactly this path; ``numpy.savez`` would append a suffix."""
    arrays: dict[str, Any] = dict(maps)
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


if __name__ == "__main__":
    main()
