"""Opening of files, and conversion of all errors of their decoders into one-line messages."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

from occjax.errors import InputError
from occjax.io.limits import ReadLimits


@contextmanager
def read_errors(path: Path) -> Iterator[None]:
    """Turn errors of the operating system on reading ``path`` into an :class:`InputError`.

    Args:
        path: File or folder that the body opens.

    Raises:
        InputError: If ``path`` is missing, not readable, or not a file.

    Example:
        >>> with read_errors(Path("nowhere.pfm")):
        ...     data = Path("nowhere.pfm").read_bytes()
        Traceback (most recent call last):
        ...
        occjax.errors.InputError: nowhere.pfm: there is no such file or folder; check the path
    """
    try:
        yield
    except FileNotFoundError as error:
        raise InputError(f"{path}: there is no such file or folder; check the path") from error
    except PermissionError as error:
        raise InputError(f"{path}: may not be read; change its permissions") from error
    except IsADirectoryError as error:
        raise InputError(f"{path}: is a folder; name the file in it") from error
    except OSError as error:
        if error.strerror is None:  # raised by a decoder, not by the operating system
            raise
        raise InputError(f"{path}: cannot be read ({error.strerror.lower()})") from error


@contextmanager
def decoder_errors(source: Path | str, what: str, *, remedy: str) -> Iterator[None]:
    """Turn every failure of a decoder into an :class:`InputError`.

    Decoders raise exceptions of any type for damaged files, so all types are caught, including
    MemoryError and RecursionError. The body should contain the call of the decoder and nothing
    else, because an error of the program inside it would be reported as a damaged file.

    Args:
        source: What the body decodes, for the message.
        what: Kind of content that is expected, with its article: ``"an image"``.
        remedy: What the user can do.

    Raises:
        InputError: If the body raises any exception; an :class:`InputError` of the body itself
            stays as it is.

    Example:
        >>> with decoder_errors("t.csv", "a table", remedy="copy it again"):
        ...     raise ValueError("no rows")
        Traceback (most recent call last):
        ...
        occjax.errors.InputError: t.csv: cannot be decoded as a table (no rows); copy it again
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        text = re.sub(r" <[^>]*>", "", str(error))  # without addresses of Python objects
        printable = "".join(c if c.isprintable() else " " for c in text)
        reason = " ".join(printable.split())[:120] or type(error).__name__
        raise InputError(f"{source}: cannot be decoded as {what} ({reason}); {remedy}") from error


@contextmanager
def decoding(
    path: Path,
    what: str,
    *,
    remedy: str = "write or copy it again",
    max_bytes: int | float | None = None,
) -> Iterator[BufferedReader]:
    """Open a regular file, and turn every failure to read or decode it into an :class:`InputError`.

    Args:
        path: The file. A link to a regular file is followed. Pipes, devices and the files of
            ``/proc``, which can block or never end, are refused.
        what: Kind of file that is expected, as for :func:`decoder_errors`.
        remedy: What the user can do.
        max_bytes: Largest size of the file; by default that of a light field in
            :class:`occjax.io.limits.ReadLimits`.

    Yields:
        The file, at its start. The body should contain nothing but the call of the decoder.

    Raises:
        InputError: As :func:`read_errors` and :func:`decoder_errors`, and if the file is no regular
            file, empty or too large.

    Example:
        >>> with decoding(Path("nowhere.csv"), "a table") as file:
        ...     text = file.read()
        Traceback (most recent call last):
        ...
        occjax.errors.InputError: nowhere.csv: there is no such file or folder; check the path
    """
    with (
        decoder_errors(path, what, remedy=remedy),
        read_errors(path),
        open(path, "rb", opener=_open_without_waiting) as file,
    ):
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise InputError(f"{path}: is a pipe or a device; name a regular file")
        size = file_size(file)
        if size == 0:
            raise ValueError("it is empty")
        if max_bytes is None:
            ReadLimits.current().check_bytes(path, size)
        elif size > max_bytes:
            raise InputError(f"{path}: has {size} bytes, too many for {what}; {remedy}")
        yield file


def _open_without_waiting(path: str, flags: int) -> int:
    """Open a file; of a pipe, do not wait for the other end."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def file_size(file: BufferedReader) -> int:
    """Return the size of an open file, in bytes."""
    return os.fstat(file.fileno()).st_size
