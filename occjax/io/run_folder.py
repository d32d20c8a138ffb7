"""Folders of long computations: a training run, a pool of light fields, prepared samples.

Such a computation may be interrupted, resumed or started again. A JSON file in the folder stores
its settings, so that results of different settings are never mixed.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from occjax.errors import InputError
from occjax.io.atomic import atomic_path, check_writable
from occjax.io.files import decoding


def open_run_folder(
    folder: Path,
    name: str,
    settings: Mapping[str, Any],
    *,
    contents: str,
    may_differ: Collection[str] = (),
) -> dict[str, Any]:
    """Create a run folder, or verify that an existing one was made with the same settings.

    Args:
        folder: Folder, which may be missing or empty.
        name: Name of the JSON file in it that stores the settings.
        settings: Everything that the results depend on. Paths are stored as text.
        contents: What the folder holds, in words, for messages: ``"a training run"``.
        may_differ: Names of settings that may differ from those of an existing folder.

    Returns:
        The settings that the folder stores; they equal ``settings`` except for ``may_differ``.

    Raises:
        InputError: If the folder was made with other settings, contains something else, or cannot
            be written, or if the JSON file is damaged.

    Example:
        >>> import tempfile
        >>> pool = Path(tempfile.mkdtemp()) / "pool"
        >>> open_run_folder(pool, "pool.json", {"seed": 1}, contents="a pool")
        {'seed': 1}
        >>> try:
        ...     open_run_folder(pool, "pool.json", {"seed": 2}, contents="a pool")
        ... except InputError as error:
        ...     print(str(error).removeprefix(str(pool)))
        : holds a pool with other settings: seed is 1, not 2; choose another folder
    """
    check_writable(folder)
    file = folder / name
    expected: dict[str, Any] = json.loads(json.dumps(settings, default=str))  # as it is read back
    if file.exists():
        stored = read_description(file)
        compared = [
            {field: value for field, value in description.items() if field not in may_differ}
            for description in (expected, stored)
        ]
        difference = first_difference(*compared)
        if difference is not None:
            raise InputError(
                f"{folder}: holds {contents} with other settings: {difference}; "
                "choose another folder"
            )
        return stored
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"{folder}: is neither empty nor {contents}; choose another folder")
    write_description(file, expected)
    return expected


def write_description(file: Path, description: Mapping[str, Any]) -> None:
    """Write a JSON object, atomically.

    Args:
        file: File to write; an existing file is replaced.
        description: Values that JSON can store. Tuples become lists, paths become text.

    Raises:
        InputError: If the file cannot be written.
    """
    with atomic_path(file) as temporary:
        text = json.dumps(description, indent=2, default=str)
        temporary.write_text(text + "\n", encoding="utf-8")


def read_description(file: Path) -> dict[str, Any]:
    """Read a JSON object that :func:`write_description` wrote.

    Returns:
        The object, which is not empty.

    Raises:
        InputError: If the file is missing or damaged.
    """
    with decoding(file, "a JSON object", remedy="choose another folder", max_bytes=2**24) as stored:
        description = json.load(stored)
        if not isinstance(description, dict) or not description:
            raise ValueError("it is empty or not a JSON object")
        return description


def first_difference(expected: Any, stored: Any) -> str | None:
    """Describe the first field in which two nested descriptions differ.

    Args:
        expected: A description, as ``dataclasses.asdict`` or JSON gives it.
        stored: The description to compare it with.

    Returns:
        For instance ``"optimiser.peak_rate is 0.001, not 0.01"`` (the stored value comes first), or
        None if they agree.

    Example:
        >>> first_difference({"loss": {"border": 2}}, {"loss": {"border": 0}})
        'loss.border is 0, not 2'
    """
    ours, theirs = dict(_leaves(expected)), dict(_leaves(stored))
    for name in (*ours, *theirs):
        if name not in ours or name not in theirs or ours[name] != theirs[name]:
            return f"{name} is {theirs.get(name, 'absent')}, not {ours.get(name, 'absent')}"
    return None


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of a nested description with their paths, such as ``stages[0].width``."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves(item, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list | tuple) and value and isinstance(value[0], dict):
        for index, item in enumerate(value):
            yield from _leaves(item, f"{name}[{index}]")
    else:
        yield name, list(value) if isinstance(value, tuple) else value
