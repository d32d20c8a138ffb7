"""Rendering of a scene: Blender in a separate process, then the ground truth."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from experiments.blender.config import RenderConfig
from experiments.blender.folder import missing_views, read_record, write_ground_truth
from occjax.errors import InputError
from occjax.io.atomic import check_writable

BLENDER_VARIABLE = "OCCJAX_BLENDER_PYTHON"
"""Environment variable with the path of a Python interpreter that has ``bpy``."""

Progress = Callable[[int, int], None]
"""Callback for the number of finished views and the number of all views."""


def render_scene(
    folder: str | Path,
    config: RenderConfig,
    *,
    blender: str | Path | None = None,
    threads: int = 0,
    progress: Progress | None = None,
) -> Path:
    """Render a light field with its ground truth to a folder in the layout of the HCI benchmark.

    Existing views of the same scene are kept, so that an interrupted rendering resumes.
    :func:`occjax.load` reads the complete folder.

    Args:
        folder: Folder of the scene; it is created if necessary.
        config: Settings of the scene.
        blender: Python interpreter that has ``bpy``; see :func:`find_blender`.
        threads: Threads of the renderer; 0 for one per core.
        progress: Called after each view.

    Returns:
        The folder.

    Raises:
        InputError: If Blender is not found, the folder cannot be written, or it contains another
            scene.
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
    """Return the Python interpreter that has ``bpy``, Blender as a module.

    It can differ from the interpreter that runs occjax, because ``bpy`` supports one version of
    Python and needs an older NumPy.

    Args:
        python: The interpreter; None for the one that the environment variable
            ``OCCJAX_BLENDER_PYTHON`` names, or else the current one.

    Raises:
        InputError: If there is no such interpreter.
    """
    named = python or os.environ.get(BLENDER_VARIABLE)
    if named:
        if not Path(named).is_file():
            raise InputError(f"{named}: is not a Python interpreter; pass the one that has bpy")
        return str(named)
    if importlib.util.find_spec("bpy") is None:
        raise InputError(
            "Blender is not installed; create an environment for it (python3.11 -m venv blender; "
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
    """Render views by ``python -m kit`` and report its progress."""
    job = {
        "folder": str(folder.resolve()),
        "config": config.as_dict(),
        "views": missing,
        "threads": threads,
    }
    # The path has only the folder of the kit, whose Python does not need occjax.
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    done = config.views - len(missing)
    with tempfile.TemporaryFile("w+") as errors:
        with subprocess.Popen(
            [python, "-m", "kit", json.dumps(job)],
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
    """Raise an error that states why Blender failed."""
    # NumPy is imported first, and the environment of bpy includes it.
    if "No module named 'bpy'" in errors or "No module named 'numpy'" in errors:
        raise InputError(f"{python}: does not have bpy; install it there (pip install bpy)")
    lines = [line for line in errors.splitlines() if line.strip()]
    raise RuntimeError(f"{folder}: Blender ended with code {code}: {lines[-1] if lines else ''}")
