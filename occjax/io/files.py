"""Conversion of errors of reading files into one-line messages."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from occjax.errors import InputError


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn errors of the operating system on reading ``path`` into an :class:`InputError`.

    Args:
        path: File or folder that the body opens.

    Raises:
        InputError: If ``path`` is missing, not readable, or not a file.

    Example:
        >>> with reading(Path("nowhere.pfm")):
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
def decoding(path: Path, what: str, *, remedy: str = "write or copy it again") -> Iterator[None]:
    """Turn every failure to read or decode ``path`` into an :class:`InputError`.

    Decoders raise exceptions of many types for damaged files, so all types are caught. The body
    should contain the call of the decoder and nothing else, because an error of the program inside
    it would be reported as a damaged file.

    Args:
        path: File that the body reads.
        what: Kind of file that is expected, with its article: ``"an image"``.
        remedy: What the user can do.

    Raises:
        InputError: As :func:`reading`, and if the body raises any other exception.

    Example:
        >>> with decoding(Path("t.txt"), "a table", remedy="copy it again"):
        ...     raise ValueError("no rows")
        Traceback (most recent call last):
        ...
        occjax.errors.InputError: t.txt: cannot be decoded as a table (no rows); copy it again
    """
    try:
        with reading(path):
            yield
    except InputError:
        raise
    except Exception as error:
        text = re.sub(r" <[^>]*>", "", str(error))  # without addresses of Python objects
        reason = " ".join(text.split())[:120] or type(error).__name__
        raise InputError(f"{path}: cannot be decoded as {what} ({reason}); {remedy}") from error
