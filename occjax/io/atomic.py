"""Files and folders that appear whole or not at all.

A writer works on a temporary name beside the final one, so that an error, a full disk or an
interrupted run leaves nothing half-written where the user looks for the result.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from itertools import takewhile
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
def atomic_folder(path: str | Path, *, owned: Collection[str] = ()) -> Iterator[Path]:
    """Write a folder of files atomically.

    Args:
        path: Where the folder shall be. A folder that is there already is kept: files written now
            replace those of the same name, one by one, once all of them are complete and none of
            their names is taken by a folder; files the body did not write stay untouched, since
            they may be the user's.
        owned: Names of files in the folder that are the body's to write: those it did not write
            this time are left from an earlier time, and are removed.

    Yields:
        An empty folder, inside ``path`` if that is there and else beside it, for the body to fill.

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
    # A folder that is there may be the root of a file system: what is beside it is on another one,
    # from where files cannot be renamed into it.
    temporary = _temporary_beside(path / "new" if path.is_dir() else path)
    try:
        with _writing(path, temporary):
            temporary.mkdir(parents=True)
            yield temporary
            _move_into_place(temporary, path, owned)
    except CannotWriteError as error:
        if not error.path.is_relative_to(temporary):
            raise
        # The temporary folder is gone when the message is read.
        final = path / error.path.relative_to(temporary)
        raise CannotWriteError(final, error.reason) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_writable(folder: str | Path) -> None:
    """Find out whether a folder can be written, before the work whose results shall go there.

    Tries it: whatever is made to find out is removed again.

    Args:
        folder: A folder that may be there or not yet.

    Raises:
        InputError: If it is a file, or cannot be made or written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "results"
        >>> check_writable(path / "today")
        >>> path.exists()
        False
        >>> _ = path.write_text("in the way")
        >>> try:
        ...     check_writable(path)
        ... except InputError as error:
        ...     print(str(error).removeprefix(str(path)))
        : cannot be written (it is a file); choose another place
    """
    folder = Path(folder)
    made: list[Path] = []
    try:
        missing = list(takewhile(lambda place: not place.exists(), (folder, *folder.parents)))
        present = missing[-1].parent if missing else folder
        if not present.is_dir():
            itself = "it" if present == folder else present
            raise CannotWriteError(folder, f"{itself} is a file")
        for place in (*reversed(missing), _temporary_beside(folder / "new")):
            place.mkdir()
            made.append(place)
    except OSError as error:
        raise CannotWriteError(folder, _reason(error)) from error
    finally:
        for place in reversed(made):
            with suppress(OSError):
                place.rmdir()


class CannotWriteError(InputError):
    """A file or folder cannot be written.

    Attributes:
        path: Which one.
        reason: Why, in a few words.
    """

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path}: cannot be written ({reason}); choose another place")
        self.path, self.reason = path, reason


def _temporary_beside(path: Path) -> Path:
    """A hidden sibling: ``os.replace`` is atomic only within one file system.

    The suffix is kept because many writers choose the format by it.
    """
    return path.with_name(f".{path.stem}.{secrets.token_hex(4)}{path.suffix}")


def _move_into_place(temporary: Path, path: Path, owned: Collection[str]) -> None:
    """Rename the folder, or if one is there already, its files."""
    if not path.exists():
        os.replace(temporary, path)
        return
    sources = sorted(temporary.rglob("*"))
    moves = [(source, path / source.relative_to(temporary)) for source in sources]
    for source, target in moves:
        if target.is_dir() and not source.is_dir():
            raise CannotWriteError(target, "a folder has its name")
        if source.is_dir() and target.exists() and not target.is_dir():
            raise CannotWriteError(target, "a file has its name")
    for source, target in moves:
        if source.is_dir():
            target.mkdir(exist_ok=True)
        else:
            os.replace(source, target)
    for name in set(owned) - {target.name for _, target in moves if target.parent == path}:
        if not (path / name).is_dir():
            (path / name).unlink(missing_ok=True)


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
        raise CannotWriteError(path, _reason(error)) from error


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
