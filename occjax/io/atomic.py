"""Files and folders that appear whole or not at all.

A writer works on a temporary name beside the final one, so that an error, a full disk or an
interrupted run leaves nothing half-written where the user looks for the result.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from occjax.errors import InputError


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Write one file atomically.

    Args:
        path: Where the file shall be. Missing parent folders are made; a file there is replaced.

    Yields:
        A path in the same folder and with the same suffix, for the body to write. It becomes
        ``path`` when the body ends, and is removed when the body raises.

    Raises:
        InputError: If nothing can be written there.

    Example:
        >>> import tempfile
        >>> folder = Path(tempfile.mkdtemp())
        >>> with atomic_path(folder / "note.txt") as temporary:
        ...     _ = temporary.write_text("whole")
        >>> [entry.name for entry in folder.iterdir()]
        ['note.txt']
    """
    path = Path(path)
    temporary = _temporary_beside(path)
    try:
        with _writing(path, temporary):
            path.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            os.replace(temporary, path)
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def atomic_folder(path: str | Path) -> Iterator[Path]:
    """Write a folder of files atomically.

    Args:
        path: Where the folder shall be. A folder that is there already is kept: files written now
            replace those of the same name, one by one, once all of them are complete; files the
            body did not write stay untouched, since they may be the user's.

    Yields:
        An empty folder beside ``path`` for the body to fill.

    Raises:
        InputError: If nothing can be written there.

    Example:
        >>> import tempfile
        >>> folder = Path(tempfile.mkdtemp()) / "scene"
        >>> with atomic_folder(folder) as temporary:
        ...     _ = (temporary / "summary.json").write_text("{}")
        >>> [entry.name for entry in folder.iterdir()]
        ['summary.json']
    """
    path = Path(path)
    temporary = _temporary_beside(path)
    try:
        with _writing(path, temporary):
            temporary.mkdir(parents=True)
            yield temporary
            _move_into_place(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _temporary_beside(path: Path) -> Path:
    """A hidden sibling: ``os.replace`` is atomic only within one file system.

    The suffix is kept because many writers choose the format by it.
    """
    return path.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix}")


def _move_into_place(temporary: Path, path: Path) -> None:
    """Rename the folder, or if one is there already, its files."""
    if not path.exists():
        os.replace(temporary, path)
        return
    for source in sorted(temporary.rglob("*")):
        target = path / source.relative_to(temporary)
        if source.is_dir():
            target.mkdir(exist_ok=True)
        else:
            os.replace(source, target)


@contextmanager
def _writing(path: Path, temporary: Path) -> Iterator[None]:
    """Turn failures to write ``temporary`` into an error about ``path``."""
    try:
        yield
    except OSError as error:
        # The body may read other files, too; their errors are not about this path. A full disk
        # raises without a file name.
        about = error.filename
        concerned = {temporary, *temporary.parents}
        if (
            about is not None
            and Path(about) not in concerned
            and temporary not in Path(about).parents
        ):
            raise
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"{path}: cannot be written ({reason}); choose another place") from error
