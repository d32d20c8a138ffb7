"""Read, estimate and write several scenes on all devices; the three steps overlap.

Each device has three threads: while one scene is estimated, a thread reads the next one, and
another thread writes the results of the one before. Reading is at most one scene ahead and writing
at most one behind, which bounds the memory. The writing thread also prints, so that results and
errors of one device appear in the order of its scenes.

A running program of JAX cannot be interrupted. So the main thread only waits, and ends the process
on Ctrl-C or SIGTERM. Scenes are written atomically, so nothing has to be undone.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, NoReturn, TypeVar

import jax
from tqdm import tqdm

from occjax.cli.running import phase_reporter
from occjax.errors import InputError
from occjax.estimators.phases import Phase, ReportPhase
from occjax.io.atomic import CannotWriteError

FAILURES = (InputError, MemoryError, OSError, ValueError, RuntimeError)
"""Errors of one scene, which do not stop the others."""

_Loaded = TypeVar("_Loaded")
_Result = TypeVar("_Result")


@dataclass
class Pipelines(Generic[_Loaded, _Result]):
    """Threads that read, estimate and write scenes, three for each device.

    Attributes:
        names: Name of each scene.
        read: Reads a scene.
        estimate: Estimates what was read; it reports its phases.
        write: Writes a result under the name of its scene, and returns the text to print.
        single_scene: Whether the command has one scene, whose error is then raised.
    """

    names: Mapping[Path, str]
    read: Callable[[Path], _Loaded]
    estimate: Callable[[_Loaded, ReportPhase], _Result]
    write: Callable[[str, _Result], str]
    single_scene: bool

    def __post_init__(self) -> None:
        """Create what the threads share."""
        self._remaining, self._lock = iter(self.names), threading.Lock()
        self._stopped = threading.Event()
        self._cannot_write: CannotWriteError | None = None
        self._failed: dict[Path, str] = {}
        self._written = 0
        self._writing: dict[jax.Device, Future[None]] = {}
        hidden = self.single_scene or None  # None: hidden unless the output is a terminal
        self._progress = tqdm(total=len(self.names), unit="scene", disable=hidden, leave=False)

    def run(self) -> dict[Path, str]:
        """Read, estimate and write all scenes.

        Returns:
            The scenes that failed, with the reason.

        Raises:
            InputError: If results cannot be written, or the only scene fails.
        """
        devices = jax.local_devices()[: len(self.names)]
        threads = ThreadPoolExecutor(len(devices))
        # Otherwise a fast device could read ahead and take the first scene of a slow one.
        first = [next(self._remaining) for _ in devices]
        running = [threads.submit(self._run_on, *pair) for pair in zip(devices, first, strict=True)]
        try:
            with _termination_as_interrupt():
                for future in wait(running, return_when=FIRST_EXCEPTION).done:
                    future.result()  # raises the error of a thread
        except KeyboardInterrupt as interrupt:
            self.abandon(128 + (signal.SIGTERM if "SIGTERM" in interrupt.args else signal.SIGINT))
        finally:
            self._stopped.set()
            threads.shutdown()
            self._progress.close()
        if self._cannot_write is not None:
            error = self._cannot_write
            if self.single_scene:
                raise error
            raise InputError(
                f"{error.path}: cannot be written ({error.reason}); scenes written: "
                f"{self._written}; free space or choose another place, then run the command again"
            ) from error
        return {scene: self._failed[scene] for scene in self.names if scene in self._failed}

    def _run_on(self, device: jax.Device, first: Path) -> None:
        """Estimate one scene after the other on a device, until none remains."""
        reading_thread, writing_thread = ThreadPoolExecutor(1), ThreadPoolExecutor(1)

        def read_here(scene: Path) -> _Loaded:
            with jax.default_device(device):  # a setting of each thread
                return self.read(scene)

        def start_next() -> tuple[Path, Future[_Loaded]] | None:
            with self._lock:
                scene = None if self._stopped.is_set() else next(self._remaining, None)
            return None if scene is None else (scene, reading_thread.submit(read_here, scene))

        try:
            upcoming: tuple[Path, Future[_Loaded]] | None
            upcoming = first, reading_thread.submit(read_here, first)
            while upcoming is not None and not self._stopped.is_set():
                scene, reading = upcoming
                report_phase = phase_reporter(self._progress, self.names[scene])
                result: _Result | Exception
                try:
                    report_phase(Phase.READING)
                    try:
                        loaded = reading.result()
                    finally:
                        upcoming = start_next()
                    with jax.default_device(device):
                        result = self.estimate(loaded, report_phase)
                except FAILURES as error:
                    result = error
                report_phase(Phase.FAILED if isinstance(result, Exception) else Phase.WRITING)
                if device in self._writing:
                    self._writing[device].result()
                if not self._stopped.is_set():
                    self._writing[device] = writing_thread.submit(self._finish, scene, result)
            if device in self._writing:
                self._writing[device].result()
        finally:
            reading_thread.shutdown(cancel_futures=True)
            writing_thread.shutdown(cancel_futures=True)

    def _finish(self, scene: Path, result: _Result | Exception) -> None:
        """Write a result and print it, or print why there is none.

        An error that is raised here reaches :meth:`run` through the future of the thread.
        """
        try:
            if isinstance(result, Exception):
                raise result
            tqdm.write(self.write(self.names[scene], result))
            with self._lock:
                self._written += 1
        except CannotWriteError as error:
            self._cannot_write = error
            self._stopped.set()
        except FAILURES as error:
            if self.single_scene:
                raise
            # Only the message of an InputError is written for users.
            kind = "" if isinstance(error, InputError) else f"{scene}: {type(error).__name__}: "
            self._failed[scene] = f"{kind}{error}"
            tqdm.write(f"occjax: {kind}{error}", file=sys.stderr)
        self._progress.update()

    def abandon(self, code: int) -> NoReturn:
        """End the process without waiting for what JAX compiles or runs.

        Scenes that are being written have five seconds to finish.
        """
        self._stopped.set()
        wait(list(self._writing.values()), timeout=5.0)
        self._progress.close()
        with suppress(OSError):
            print(
                f"occjax: interrupted; scenes written: {self._written}"
                + "; the same command estimates the others" * (not self.single_scene),
                file=sys.stderr,
                flush=True,
            )
            sys.stdout.flush()
        os._exit(code)


@contextmanager
def _termination_as_interrupt() -> Iterator[None]:
    """Let SIGTERM interrupt the main thread like Ctrl-C."""
    if threading.current_thread() is not threading.main_thread():  # it alone handles signals
        yield
        return

    def interrupt(*_: object) -> NoReturn:
        raise KeyboardInterrupt("SIGTERM")

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
