"""Exit codes of the commands, and warnings and errors as one line each."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable
from typing import NoReturn

from tqdm import tqdm

from occjax.errors import InputError


def exit_with(command: Callable[[], int]) -> NoReturn:
    """Run a command and exit with its code.

    An :class:`InputError` is printed as one line and exits with code 2.

    Args:
        command: Returns the exit code.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = show_warning
        sys.exit(_exit_code(command))


def show_warning(message, category, filename, lineno, file=None, line=None) -> None:
    """Print a warning as one line, without its position in the source code."""
    tqdm.write(f"occjax: warning: {message}", file=sys.stderr)


def _exit_code(command: Callable[[], int]) -> int:
    try:
        code = command()
        sys.stdout.flush()
    except InputError as error:
        print(f"occjax: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of the output, such as head, has closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except KeyboardInterrupt:
        print("occjax: interrupted", file=sys.stderr)
        return 130
    return code
