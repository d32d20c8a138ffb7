"""Folders that long work fills and that say what of: a pool, prepared light fields, a training.

The work is interrupted, goes on, or is asked for again; a description beside the results tells
whether they are those of the same work.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from occjax.errors import InputError
from occjax.io.atomic import atomic_path, check_writable
from occjax.io.files import reading


def claim_folder(
    folder: Path,
    name: str,
    wanted: Mapping[str, Any],
    *,
    contents: str,
    may_differ: Collection[str] = (),
) -> dict[str, Any]:
    """Make a folder that of some work, or see that it is already that of the same.

    Args:
        folder: May be missing or empty.
        name: Of the file in it with the description.
        wanted: All that the results depend on, as JSON can hold it; paths become text.
        contents: What the folder holds, in words, for messages.
        may_differ: Fields of the description that may be others in a folder that is there.

    Returns:
        The description in the folder: what is wanted, but for fields that may differ.

    Raises:
        InputError: If the folder is that of other work, or has something else in it, or cannot be
            written, or its description is damaged.

    Example:
        >>> import tempfile
        >>> pool = Path(tempfile.mkdtemp()) / "pool"
        >>> claim_folder(pool, "pool.json", {"seed": 1}, contents="a pool")
        {'seed': 1}
        >>> try:
        ...     claim_folder(pool, "pool.json", {"seed": 2}, contents="a pool")
        ... except InputError as error:
        ...     print(str(error).removeprefix(str(pool)))
        : holds a pool with other settings: seed is 1, not 2; choose another folder
    """
    check_writable(folder)
    wanted, file = _as_json(wanted), folder / name
    if file.exists():
        found = read_description(file)
        compared = [
            {field: value for field, value in description.items() if field not in may_differ}
            for description in (wanted, found)
        ]
        difference = first_difference(*compared)
        if difference is not None:
            raise InputError(
                f"{folder}: holds {contents} with other settings: {difference}; "
                "choose another folder"
            )
        return found
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"{folder}: is neither empty nor {contents}; choose another folder")
    write_description(file, wanted)
    return wanted


def write_description(file: Path, description: Mapping[str, Any]) -> None:
    """Write a description that :func:`read_description` reads.

    Args:
        file: JSON; replaced if it is there.
        description: As JSON can hold it; paths become text.

    Raises:
        InputError: If it cannot be written.
    """
    with atomic_path(file) as temporary:
        text = json.dumps(_as_json(description), indent=2)
        temporary.write_text(text + "\n", encoding="utf-8")


def read_description(file: Path) -> dict[str, Any]:
    """Read what :func:`claim_folder` or :func:`write_description` wrote.

    Args:
        file: JSON.

    Returns:
        The description.

    Raises:
        InputError: If there is none or it is damaged.
    """
    with reading(file):
        text = file.read_text(encoding="utf-8")
    try:
        description = json.loads(text)
    except ValueError as error:
        raise InputError(f"{file}: is damaged ({error}); choose another folder") from error
    if not isinstance(description, dict) or not description:
        raise InputError(f"{file}: is damaged (it describes nothing); choose another folder")
    return description


def first_difference(wanted: Any, stored: Any) -> str | None:
    """The first field in which two descriptions differ, in words.

    Args:
        wanted: A description, as ``dataclasses.asdict`` or JSON gives it.
        stored: Another one.

    Returns:
        For instance ``"optimiser.peak_rate is 0.001, not 0.01"`` (the stored value comes first), or
        None if they agree.

    Example:
        >>> first_difference({"loss": {"border": 2}}, {"loss": {"border": 0}})
        'loss.border is 0, not 2'
    """
    ours, theirs = dict(_leaves(wanted)), dict(_leaves(stored))
    for name in (*ours, *theirs):
        if name not in ours or name not in theirs or ours[name] != theirs[name]:
            return f"{name} is {theirs.get(name, 'absent')}, not {ours.get(name, 'absent')}"
    return None


def _as_json(description: Mapping[str, Any]) -> dict[str, Any]:
    """The description as it will be read: tuples become lists."""
    return json.loads(json.dumps(description, default=str))


def _leaves(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Values of a tree of dictionaries and sequences with their paths, ``stages[0].width``."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves(item, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list | tuple) and value and isinstance(value[0], dict):
        for index, item in enumerate(value):
            yield from _leaves(item, f"{name}[{index}]")
    else:
        yield name, list(value) if isinstance(value, tuple) else value
