"""Atomic writing: files and folders appear complete or not at all.

A writer fills a temporary file or folder next to the final one, which is renamed at the end. An
error, a full disk or an interrupted run leaves no incomplete result. A killed process leaves its
temporary files. Their names contain machine and process, so that :func:`remove_leftovers` can
recognise and remove them.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import secrets
import shutil
import socket
import stat
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from occjax.errors import InputError

TEMPORARY_NAME = re.compile(
    r"\..+\.(?P<machine>[0-9a-f]{8})-(?P<pid>\d{1,9})-[0-9a-f]{8}(\.[^.]*)?", re.DOTALL
)
"""Names of temporary files and folders; see :func:`_temporary_path`."""


class CannotWriteError(InputError):
    """A file or folder cannot be written.

    Attributes:
        path: The file or folder.
        reason: Why, in a few words.
    """

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path}: cannot be written ({reason}); choose another place")
        self.path, self.reason = path, reason


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Write one file atomically.

    Args:
        path: File to write. Missing parent folders are created; an existing file is replaced.

    Yields:
        A temporary path in the same folder and with the same suffix, which the body writes. It is
        renamed to ``path`` when the body ends, and removed when the body raises.

    Raises:
        InputError: If the file cannot be written.

    Example:
        >>> import tempfile
        >>> folder = Path(tempfile.mkdtemp())
        >>> with atomic_path(folder / "note.txt") as temporary:
        ...     _ = temporary.write_text("whole")
        >>> [entry.name for entry in folder.iterdir()]
        ['note.txt']
    """
    path = Path(path)
    temporary = _temporary_path(path)
    try:
        with _writing(path, temporary):
            path.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            os.replace(temporary, path)
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def atomic_folder(
    path: str | Path, *, owned: Collection[str] = (), marker: str | None = None
) -> Iterator[Path]:
    """Write a folder of files atomically.

    Args:
        path: Folder to write. If it exists, the new files replace files of the same name, one by
            one, once all of them are written. Other files in it are kept, since they may be the
            user's.
        owned: Relative paths of files that belong to the writer: those that the body does not write
            are left over from an earlier run and are removed.
        marker: Name of a file whose presence shows that all files belong together: in an existing
            folder it is removed before the first file is replaced, and is the last one to appear.

    Yields:
        An empty temporary folder for the body to fill. It is inside ``path`` if that exists,
        otherwise next to it.

    Raises:
        InputError: If the folder cannot be written.

    Example:
        >>> import tempfile
        >>> folder = Path(tempfile.mkdtemp()) / "scene"
        >>> with atomic_folder(folder) as temporary:
        ...     _ = (temporary / "summary.json").write_text("{}")
        >>> [entry.name for entry in folder.iterdir()]
        ['summary.json']
    """
    path = Path(path)
    # An existing folder may be the root of a file system. A folder next to it would be on another
    # one, and files cannot be renamed across file systems.
    temporary = _temporary_path(path / "new" if path.is_dir() else path)
    try:
        with _writing(path, temporary):
            temporary.mkdir(parents=True)
            yield temporary
            _move_into_place(temporary, path, owned, marker)
    except CannotWriteError as error:
        if not error.path.is_relative_to(temporary):
            raise
        # The temporary folder no longer exists when the user reads the message.
        final = path / error.path.relative_to(temporary)
        raise CannotWriteError(final, error.reason) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_writable(folder: str | Path) -> None:
    """Verify that a folder can be written, before a long computation whose results go there.

    The test creates a temporary folder in the nearest existing parent, with the missing folders in
    it, and removes it.

    Args:
        folder: A folder, which may not exist yet.

    Raises:
        InputError: If it is a file, or cannot be created or written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "results"
        >>> check_writable(path / "today")
        >>> path.exists()
        False
        >>> _ = path.write_text("a file")
        >>> try:
        ...     check_writable(path)
        ... except InputError as error:
        ...     print(str(error).removeprefix(str(path)))
        : cannot be written (it is a file); choose another place
    """
    folder = Path(folder)
    try:
        present = next(place for place in (folder, *folder.parents) if os.path.lexists(place))
        if not stat.S_ISDIR(present.stat().st_mode):
            itself = "it" if present == folder else present
            raise CannotWriteError(folder, f"{itself} is a file")
        temporary = _temporary_path(present / "new")
        try:
            (temporary / folder.relative_to(present)).mkdir(parents=True)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        raise CannotWriteError(folder, _reason(error)) from error


def remove_leftovers(folder: str | Path) -> list[Path]:
    """Remove temporary files and folders that killed processes have left in a folder.

    Files of a running process are kept. This machine cannot tell whether a process on another
    machine still runs; files of other machines are removed if they are older than a day.

    Args:
        folder: Folder in which files or folders were written; it may be missing. Folders in it are
            not searched.

    Returns:
        Paths of the removed files and folders. Those that cannot be deleted are left.

    Example:
        >>> import tempfile
        >>> remove_leftovers(tempfile.mkdtemp())
        []
    """
    removed: list[Path] = []
    try:
        entries = list(os.scandir(folder))
    except OSError:
        return removed
    for entry in entries:
        made_by = TEMPORARY_NAME.fullmatch(entry.name)
        if made_by is None:
            continue
        with suppress(OSError):  # of this entry, so that the others are removed
            if _is_abandoned(entry, made_by["machine"], int(made_by["pid"])):
                if entry.is_dir(follow_symlinks=False):
                    shutil.rmtree(entry.path, ignore_errors=True)
                else:
                    os.unlink(entry.path)
                if not os.path.lexists(entry.path):
                    removed.append(Path(entry.path))
    return removed


def _is_abandoned(entry: os.DirEntry, machine: str, pid: int) -> bool:
    """Return whether the process of a temporary file has ended; elsewhere, whether it is old."""
    if machine != _machine():
        return time.time() - entry.stat(follow_symlinks=False).st_mtime > 24 * 3600.0
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    except OSError:  # the process exists and belongs to another user
        return False
    return False


def _temporary_path(path: Path) -> Path:
    """Return a hidden path in the same folder, since renaming is atomic within a file system.

    The suffix is kept because many writers choose the format by it.
    """
    unique = f"{_machine()}-{os.getpid()}-{secrets.token_hex(4)}"
    return path.with_name(f".{path.stem}.{unique}{path.suffix}")


@functools.cache
def _machine() -> str:
    """Return a name of the machine, or container, within which process ids are unique."""
    processes = ""
    with suppress(OSError):
        processes = os.readlink("/proc/self/ns/pid")
    return hashlib.sha256(f"{socket.gethostname()} {processes}".encode()).hexdigest()[:8]


def _move_into_place(
    temporary: Path, path: Path, owned: Collection[str], marker: str | None
) -> None:
    """Rename the folder to ``path``; if that exists, move the files one by one, the marker last."""
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
    stale = set(owned) - {target.relative_to(path).as_posix() for _, target in moves}
    for name in (marker, *stale):
        if name is not None and not (path / name).is_dir():
            (path / name).unlink(missing_ok=True)
    marker_last = sorted(moves, key=lambda move: move[1].name == marker)
    for source, target in marker_last:
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
        # The body may also read other files; their errors are not changed. The error of a full disk
        # has no file name.
        if error.filename is not None:
            failed = Path(error.filename)
            if not (temporary.is_relative_to(failed) or failed.is_relative_to(temporary)):
                raise
        raise CannotWriteError(path, _reason(error)) from error


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
