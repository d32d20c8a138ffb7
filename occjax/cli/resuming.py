"""What the results of a scene were made from, so that a second call skips what is complete."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np

import occjax
from occjax.estimators import Estimator
from occjax.estimators.driver import program_identity
from occjax.io.maps import SUMMARY
from occjax.programs import source_sha256
from occjax.results.outputs import FILES


def estimator_settings(estimator: Estimator, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the results of all scenes of a command depend on, as JSON stores it.

    Args:
        estimator: An estimator of this package.
        options: Options of the command, by name.

    Returns:
        ``occjax`` (version), ``source_sha256`` (of the code, which changes between versions),
        ``model``, ``model_sha256`` (of its configuration and its weights) and ``options``.
    """
    digest = hashlib.sha256(repr(program_identity(estimator)).encode())
    weights, _ = jax.tree_util.tree_flatten_with_path(getattr(estimator, "variables", {}))
    for path, values in weights:
        array = np.ascontiguousarray(values)
        digest.update(f"{jax.tree_util.keystr(path)} {array.shape} {array.dtype}".encode())
        digest.update(array.tobytes())
    settings = {
        "occjax": occjax.__version__,
        "source_sha256": source_sha256(),
        "model": estimator.name,
        "model_sha256": digest.hexdigest(),
        # JSON has no infinity, for instance of the focus distance.
        "options": {
            name: str(value) if value in (math.inf, -math.inf) else value
            for name, value in options.items()
        },
    }
    return json.loads(json.dumps(settings, default=str))


def files_sha256(scene: Path, *, nested: bool) -> str | None:
    """Return a hash of names, sizes and times of change of the files of a scene.

    Their content is not read. Files that ``estimate`` writes are left out, since the results may be
    written to the folder of the scene.

    Args:
        scene: File or folder.
        nested: Whether the files in sub-folders belong to the scene.

    Returns:
        The hash; None if the scene cannot be read.
    """
    digest = hashlib.sha256()
    try:
        for path in sorted(_files(scene, nested)):
            status = os.stat(path)
            name = os.path.relpath(path, scene)
            digest.update(f"{name}\0{status.st_size}\0{status.st_mtime_ns}\n".encode())
    except OSError:
        return None
    return digest.hexdigest()


def complete_summary(folder: Path, settings: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the summary of a scene's results if they are complete and have these settings.

    Args:
        folder: Folder of the results, which may be missing.
        settings: Everything that the results depend on.
    """
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        same = summary["settings"] == settings
        whole = same and all((folder / name).is_file() for name in summary["files"])
    except (OSError, ValueError, KeyError, TypeError):
        return None  # missing or damaged: the scene is estimated again
    return summary if whole else None


def _files(scene: Path, nested: bool) -> Iterator[str]:
    """Yield the files of a scene that it may be read from."""
    if scene.is_file():
        yield str(scene)
    else:
        for entry in os.scandir(scene):
            if entry.name.startswith(".") or entry.name in FILES:
                continue
            if entry.is_file():
                yield entry.path
            elif nested and entry.is_dir():
                yield from _files(Path(entry.path), nested)
