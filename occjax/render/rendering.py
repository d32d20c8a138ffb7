"""Rendering a scene: Blender in a process of its own, then the ground truth."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from occjax.errors import InputError
from occjax.io.atomic import check_writable
from occjax.render.config import RenderConfig
from occjax.render.folder import missing_views, read_record, write_ground_truth

BLENDER_VARIABLE = "OCCJAX_BLENDER_PYTHON"
"""Environment variable that names the Python that has ``bpy``."""

Progress = Callable[[int, int], None]
"""Called with the number of views that are there and the number of all views."""


def render_scene(
    folder: str | Path,
    config: RenderConfig,
    *,
    blender: str | Path | None = None,
    threads: int = 0,
    progress: Progress | None = None,
) -> Path:
    """Render a light field with its ground truth to a folder in the layout of the HCI benchmark.

    Views that are in the folder already are kept, so an interrupted rendering goes on where it
    ended. :func:`occjax.load` reads the folder when all of them are there.

    Args:
        folder: Of the scene; made if it is not there.
        config: What to render.
        blender: Python that has ``bpy``; see :func:`find_blender`.
        threads: Of the renderer; 0 for as many as there are cores.
        progress: Told after each view.

    Returns:
        The folder.

    Raises:
        InputError: If Blender is not found, or the folder cannot be written or has another scene.
        RuntimeError: If Blender fails.
    """
    folder = Path(folder)
    check_writable(folder)
    folder.mkdir(parents=True, exist_ok=True)
    begun = read_record(folder, config) is not None
    missing = missing_views(folder, config)
    if missing and len(missing) < config.views and not begun:
        raise InputError(f"{folder}: has views of another scene; choose another folder")
    if missing or not begun:
        _run_blender(find_blender(blender), folder, config, missing, threads, progress)
    write_ground_truth(folder, config)
    return folder


def find_blender(python: str | Path | None = None) -> str:
    """The Python that has ``bpy``, Blender as a module.

    It need not be the one that runs occjax, and often cannot be: ``bpy`` is made for one version
    of Python and demands an older NumPy.

    Args:
        python: The interpreter; None for that in the environment variable
            ``OCCJAX_BLENDER_PYTHON``, or else this one, if it has ``bpy``.

    Raises:
        InputError: If there is none.
    """
    named = python or os.environ.get(BLENDER_VARIABLE)
    if named:
        if not Path(named).is_file():
            raise InputError(f"{named}: is no Python interpreter; name that which has bpy")
        return str(named)
    if importlib.util.find_spec("bpy") is None:
        raise InputError(
            "Blender is not installed; make an environment for it (python3.11 -m venv blender; "
            f"blender/bin/pip install bpy) and pass --blender blender/bin/python or set "
            f"{BLENDER_VARIABLE}"
        )
    return sys.executable


def _run_blender(
    python: str,
    folder: Path,
    config: RenderConfig,
    missing: list[int],
    threads: int,
    progress: Progress | None,
) -> None:
    """Have the views rendered by ``python -m blender`` and pass on what it reports."""
    job = {
        "folder": str(folder.resolve()),
        "config": config.as_dict(),
        "views": missing,
        "threads": threads,
    }
    # The program is found by its own folder: its Python need not know occjax.
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    done = config.views - len(missing)
    with tempfile.TemporaryFile("w+") as errors:
        with subprocess.Popen(
            [python, "-m", "blender", json.dumps(job)],
            stdout=subprocess.PIPE,
            stderr=errors,
            env=environment,
            text=True,
        ) as process:
            try:
                assert process.stdout is not None
                for line in process.stdout:
                    if progress is not None and line.startswith("view "):
                        done += 1
                        progress(done, config.views)
            except BaseException:
                process.terminate()
                raise
        if process.returncode:
            errors.seek(0)
            _raise_failure(python, folder, process.returncode, errors.read())


def _raise_failure(python: str, folder: Path, code: int, errors: str) -> None:
    """Say why Blender ended early."""
    # bpy brings NumPy along, which is imported first.
    if "No module named 'bpy'" in errors or "No module named 'numpy'" in errors:
        raise InputError(f"{python}: has no bpy; install it there (pip install bpy)")
    lines = [line for line in errors.splitlines() if line.strip()]
    raise RuntimeError(f"{folder}: Blender ended with code {code}: {lines[-1] if lines else ''}")
