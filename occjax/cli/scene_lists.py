"""Lists of scenes: folders of scenes, glob patterns and text files on the command line."""

from __future__ import annotations

import glob
import math
import os
import re
from pathlib import Path

from occjax.errors import InputError
from occjax.io.containers import CONTAINER_SUFFIXES
from occjax.io.files import decoding
from occjax.io.folders import subfolder_patterns
from occjax.io.images import IMAGE_SUFFIXES
from occjax.io.naming.patterns import NAMES

ARRAY_SUFFIXES = (".npz", ".npy", *CONTAINER_SUFFIXES)
"""Suffixes of files that hold a whole light field."""


def listed_scenes(
    scenes: tuple[Path, ...],
    scenes_from: Path | None,
    *,
    expand_folders: bool = True,
    grid: tuple[int, int] | None = None,
) -> tuple[Path, ...]:
    """Return the scenes that the arguments of a command name, in their order.

    A pattern with ``*``, ``?`` or ``[`` is replaced by what it matches, and a folder without images
    of its own by its sub-folders and array files; both in natural order, 2 before 10.

    Args:
        scenes: Scenes, folders of scenes or patterns.
        scenes_from: Text file with one more of them on each line; paths are relative to the current
            folder, and empty lines and lines that begin with ``#`` are ignored.
        expand_folders: Whether folders may hold scenes; False if views are in sub-folders.
        grid: Declared ``(V, U)`` of each scene; None if it is unknown. Sub-folders of equally many
            images that form no square are then the rows of one light field.

    Returns:
        Files and folders, each once.

    Raises:
        InputError: If the file lists none, a pattern matches nothing, or the file cannot be read.

    Example:
        >>> listed_scenes((Path("one.npz"), Path("two.npz"), Path("one.npz")), None)
        (PosixPath('one.npz'), PosixPath('two.npz'))
    """
    if scenes_from is not None:
        with decoding(scenes_from, "a list of scenes") as file:
            lines = file.read().decode().splitlines()
        stripped = (line.strip() for line in lines)
        scenes += tuple(Path(line) for line in stripped if line and not line.startswith("#"))
    found = [path for scene in scenes for path in _matches(scene)]
    if expand_folders:
        found = [scene for path in found for scene in _scenes_in(path, grid)]
    if not found:
        raise InputError(f"{scenes_from}: lists no scene; write one path on each line")
    return tuple(dict.fromkeys(found))


def folder_names(scenes: tuple[Path, ...]) -> dict[Path, str]:
    """Name a folder after each scene, and after its parents where two names would collide."""
    names: dict[Path, str] = {}
    seen = set()
    for scene in scenes:
        if scene.resolve() in seen:
            continue
        seen.add(scene.resolve())
        path = Path(os.path.abspath(scene))  # a link keeps its own name
        own = (path.stem if path.is_file() else path.name) or "root"
        candidates = [own, path.name.replace(".", "_")]
        parents = path.parts[1:-1]
        candidates += ["_".join([*parents[-depth:], own]) for depth in range(1, len(parents) + 1)]
        candidates += [f"{own}_{number}" for number in range(2, len(scenes) + 2)]
        names[scene] = next(name for name in candidates if name and name not in names.values())
    return names


def frame_names(scenes: tuple[Path, ...]) -> dict[Path, str]:
    """Number the frames of a video, with zeros in front."""
    digits = max(4, len(str(len(scenes) - 1)))
    return {scene: f"{number:0{digits}}" for number, scene in enumerate(scenes)}


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts names by the numbers in them.

    Example:
        >>> sorted(map(Path, ["frame10", "frame9"]), key=natural_order)
        [PosixPath('frame9'), PosixPath('frame10')]
    """
    parts = re.findall(r"\d+|\D+", str(path))
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _matches(scene: Path) -> list[Path]:
    """Return what a pattern matches; a path that exists, or is no pattern, is itself."""
    if scene.exists() or not glob.has_magic(str(scene)):
        return [scene]
    found = [Path(name) for name in glob.glob(str(scene), recursive=True)]
    if not found:
        raise InputError(f"{scene}: nothing matches this pattern; check it")
    return sorted(found, key=natural_order)


def _scenes_in(path: Path, grid: tuple[int, int] | None) -> list[Path]:
    """Return the scenes in a folder of scenes; any other path is a scene itself."""
    if not path.is_dir():
        return [path]
    entries = [entry for entry in path.iterdir() if not entry.name.startswith(".")]
    files = [entry for entry in entries if entry.is_file()]
    if any(file.suffix.lower() in IMAGE_SUFFIXES for file in files):
        return [path]
    folders = [entry for entry in entries if entry.is_dir()]
    if len(folders) > 1 and grid is None and _hold_parts(folders) and subfolder_patterns(path):
        return [path]
    arrays = [file for file in files if file.suffix.lower() in ARRAY_SUFFIXES]
    return sorted([*folders, *arrays], key=natural_order) or [path]


def _hold_parts(folders: list[Path]) -> bool:
    """Return whether folders hold parts of one light field, not a light field each.

    Then each has equally many images: one, or a number that is not a square.
    """
    counts = set()
    for folder in folders:
        names = [path.name for path in folder.iterdir()]
        arrays = any(name.lower().endswith(ARRAY_SUFFIXES) for name in names)
        if arrays or any(known.fullmatch(name) for known in NAMES.values() for name in names):
            return False
        counts.add(sum(name.lower().endswith(IMAGE_SUFFIXES) for name in names))
    count = counts.pop()
    return not counts and (count == 1 or math.isqrt(count) ** 2 != count)
