"""Exit codes of the commands, and warnings and errors as one line each."""

from __future__ import annotations

import os
import shlex
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

from tqdm import tqdm

from occjax.errors import InputError
from occjax.estimators.phases import Phase, ReportPhase

_collected = threading.local()
"""``messages``: the warnings of a thread in :func:`collect_warnings`."""


def exit_with(command: Callable[[], int]) -> NoReturn:
    """Run a command and exit with its code.

    An :class:`InputError` is printed as one line and exits with code 2.

    Args:
        command: Returns the exit code.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = show_warning
        try:
            code = command()
            sys.stdout.flush()
        except InputError as error:
            print(f"occjax: {error}", file=sys.stderr)
            code = 2
        except BrokenPipeError:  # the reader of the output, such as head, has closed the pipe
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = 141  # 128 + SIGPIPE, as shells report it
        except KeyboardInterrupt:
            print("occjax: interrupted", file=sys.stderr)
            code = 130  # 128 + SIGINT
        sys.exit(code)


def command_line() -> str:
    """Return the command line of this process, as it can be typed again."""
    return shlex.join(["occjax", *sys.argv[1:]])


def show_warning(message, category, filename, lineno, file=None, line=None) -> None:
    """Print or collect a warning, without its position in the source code."""
    collected = getattr(_collected, "messages", None)
    if collected is None:
        print_warning(message)
    else:
        collected.append(str(message))


def print_warning(message: object) -> None:
    """Print a warning as one line."""
    tqdm.write(f"occjax: warning: {message}", file=sys.stderr)


@contextmanager
def collect_warnings() -> Iterator[list[str]]:
    """Collect the warnings of this thread, which are then not printed.

    ``warnings.catch_warnings`` would also catch those of other threads.

    Yields:
        The messages.
    """
    messages: list[str] = []
    _collected.messages = messages
    try:
        yield messages
    finally:
        del _collected.messages


def phase_reporter(progress: tqdm | None, name: str) -> ReportPhase:
    """Return a function that shows the current phase of the computation.

    It is shown on the progress bar if there is one. Otherwise a terminal has one line, which the
    next phase overwrites, and a pipe or file gets a line for each phase.

    Args:
        progress: Progress bar, or None.
        name: Name of the scene.
    """

    def show(phase: str) -> None:
        if progress is not None and not progress.disable:
            progress.set_description(f"{name}: {phase}")
        elif sys.stderr.isatty():
            print(f"\r\033[K{name}: {phase} ...", end="", file=sys.stderr, flush=True)
            if phase in (Phase.WRITING, Phase.FAILED):
                print("\r\033[K", end="", file=sys.stderr, flush=True)
        elif phase != Phase.FAILED:  # the error message reports the failure
            print(f"{name}: {phase}", file=sys.stderr, flush=True)

    return show
