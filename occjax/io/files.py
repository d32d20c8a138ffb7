"""Opening files: what the operating system refuses, said in one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from occjax.errors import InputError


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn the operating system's refusals to read ``path`` into an :class:`InputError`.

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
        if error.strerror is None:  # not the operating system: a decoder, which says why itself
            raise
        raise InputError(f"{path}: cannot be read ({error.strerror.lower()})") from error
