"""Estimate several scenes on all devices; reading, estimating and writing overlap.

Each device has three threads: while one scene is estimated, a thread reads the next one, and
another thread writes the results of the one before. Each is at most one scene ahead or behind,
which bounds the memory. The writing thread also prints, so that reports and errors of one device
appear in the order of its scenes.

The main thread only waits, so that Ctrl-C and SIGTERM end the command at once: a running program of
JAX cannot be interrupted. Scenes are written atomically, so nothing has to be undone.
"""

from __future__ import annotations

import dataclasses
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import jax
from tqdm import tqdm

from occjax import programs
from occjax.cli.frames import FrameReader, write_disparity_video
from occjax.cli.options import CameraOptions, ViewOrderOptions
from occjax.cli.resuming import complete_summary, estimator_settings, files_sha256
from occjax.cli.running import collect_warnings, command_line, print_warning
from occjax.cli.table import Row, row, stored_failures, write_table
from occjax.errors import InputError
from occjax.estimators import Estimate, Estimator, estimate_all_views, run_estimator
from occjax.estimators.driver import ReportPhase, with_report
from occjax.estimators.protocol import DisparityRange
from occjax.io.atomic import CannotWriteError, remove_remains
from occjax.lightfield import LightField
from occjax.results.outputs import OutputOptions, Outputs, write_outputs

FAILURES = (InputError, MemoryError, OSError, ValueError, RuntimeError)
"""Errors of one scene, which do not stop the others."""

MAX_SECONDS_TO_FINISH_WRITING = 5.0
"""Time for the scenes that are being written when the command is interrupted."""


@dataclasses.dataclass(frozen=True)
class RunOptions:
    """Which of the scenes are estimated, and whether they are a video.

    Attributes:
        overwrite: Whether scenes that are complete with the same settings are estimated again.
        share: ``(index, count)``: this process estimates every ``count``-th scene from ``index``.
        frames_per_second: Rate of the video whose frames are the scenes; None if they are scenes.
        view: ``(v, u)`` of the view that is estimated; None for the centre view.
        all_views: Whether the other views are estimated too.
    """

    overwrite: bool = False
    share: tuple[int, int] = (0, 1)
    frames_per_second: float | None = None
    view: tuple[int, int] | None = None
    all_views: bool = False

    def __post_init__(self) -> None:
        """Check the share and the views."""
        if self.view is not None and self.all_views:
            raise InputError("pass --view or --all-views, not both")
        index, count = self.share
        if not 0 <= index < count:
            raise InputError(
                f"the share is {index} {count}; pass the number of this process, from 0 to "
                f"{max(count, 1) - 1}, and the number of processes"
            )


class ReadScene(NamedTuple):
    """A light field, what it was read from, the warnings of its reader, and the seconds it took."""

    light_field: LightField
    settings: dict[str, Any]
    warnings: list[str]
    seconds: float


def estimate_scenes(
    scenes: tuple[Path, ...],
    folder: Path,
    estimator: Estimator,
    view_order: ViewOrderOptions,
    camera: CameraOptions,
    disparity_range: DisparityRange | None,
    options: OutputOptions,
    run: RunOptions = RunOptions(),
    *,
    html: Path | None = None,
) -> int:
    """Estimate scenes and write the results of each to a folder of its own.

    Of several scenes, ``scenes.csv`` and ``scenes.json`` are written too; of a video,
    ``disparity.mp4``.

    Args:
        scenes: Files or folders of the light fields, or of the frames of a video in their order.
        folder: Folder in which the folders are made.
        estimator: The estimator.
        view_order: How the light fields are stored.
        camera: Camera parameters, in place of those of the files.
        disparity_range: Range to search, or None.
        options: What is written.
        run: Which of the scenes are estimated.
        html: File of a report on all complete scenes, or None.

    Returns:
        The exit code: 1 if a scene failed.

    Raises:
        InputError: If the only scene fails, likewise the other errors of :data:`FAILURES`; or if
            results cannot be written, after which no further scene is estimated.
    """
    rate = run.frames_per_second
    is_video = rate is not None
    names = _frame_names(scenes) if is_video else folder_names(scenes)
    common = estimator_settings(
        estimator,
        {
            **dataclasses.asdict(view_order),
            **dataclasses.asdict(camera),
            **dataclasses.asdict(options),
            "save": sorted(options.save),
            "disparity_range": disparity_range,
            "view": run.view,
            "all_views": run.all_views,
        },
    )
    files = partial(files_sha256, nested="/" in (view_order.pattern or ""))
    if is_video:  # The first frame decides the disparity range of all frames.
        common["first_frame_sha256"] = files(scenes[0])

    def settings(scene: Path) -> dict[str, Any]:
        return {**common, "files_sha256": files(scene)}

    def completed(scene: Path) -> dict[str, Any] | None:
        return complete_summary(folder / names[scene], settings(scene))

    def collected() -> list[Row]:
        elsewhere = stored_failures(folder)
        rows = []
        for scene, name in names.items():
            summary = None if scene in failed else completed(scene)
            error = failed.get(scene)
            if summary is None and scene not in shared:  # Another process may have tried.
                error = elsewhere.get(name)
            rows.append(row(name, scene, summary, error))
        return rows

    remove_remains(folder)
    index, count = run.share
    shared = list(names)[index::count]
    for scene in shared:
        remove_remains(folder / names[scene])
    pending = [scene for scene in shared if run.overwrite or completed(scene) is None]
    _report_skipped(len(shared) - len(pending), shared, names)
    failed: dict[Path, str] = {}
    if pending:
        programs.preload()
        reader = FrameReader(scenes[0], view_order) if is_video else view_order.load
        pipelines = _Pipelines(
            {scene: names[scene] for scene in pending},
            folder,
            estimator,
            reader,
            camera,
            disparity_range,
            options,
            settings,
            run.view,
            run.all_views,
            only_scene=len(names) == 1,
        )
        failed = pipelines.run()
    if len(names) > 1:
        rows = write_table(folder, collected)
        if rate is not None and not any(entry["state"] == "missing" for entry in rows):
            _write_video(folder, rows, rate)
    if html is not None:
        places = tuple(folder / name for scene, name in names.items() if completed(scene))
        _write_report(html, places)
    if failed:
        listed = ", ".join(str(scene) for scene in failed)
        print(f"occjax: {len(failed)} of {len(names)} scenes failed: {listed}", file=sys.stderr)
    return 1 if failed else 0


@dataclasses.dataclass
class _Pipelines:
    """Threads that read, estimate and write scenes, three for each device."""

    names: dict[Path, str]
    folder: Path
    estimator: Estimator
    reader: Callable[[Path], LightField]
    camera: CameraOptions
    disparity_range: DisparityRange | None
    options: OutputOptions
    settings: Callable[[Path], dict[str, Any]]
    view: tuple[int, int] | None
    all_views: bool
    only_scene: bool

    def __post_init__(self) -> None:
        """Make what the threads share."""
        self._remaining, self._lock = iter(self.names), threading.Lock()
        self._stopped = threading.Event()
        self._cannot_write: CannotWriteError | None = None
        self._failed: dict[Path, str] = {}
        self._written = 0
        self._writing: dict[jax.Device, Future[None]] = {}
        self._progress = tqdm(
            total=len(self.names), unit="scene", disable=self.only_scene or None, leave=False
        )

    def run(self) -> dict[Path, str]:
        """Estimate all scenes.

        Returns:
            The scenes that failed, with the reason.

        Raises:
            InputError: If results cannot be written, or the only scene fails.
        """
        devices = jax.local_devices()[: len(self.names)]
        threads = ThreadPoolExecutor(len(devices))
        # The first scenes are given out here: a device that reads ahead would take another's.
        first = [next(self._remaining) for _ in devices]
        running = [threads.submit(self._run_on, *pair) for pair in zip(devices, first, strict=True)]
        try:
            with _termination_as_interrupt():
                for future in wait(running, return_when=FIRST_EXCEPTION).done:
                    future.result()
        except KeyboardInterrupt as interrupt:
            self._abandon(143 if "SIGTERM" in interrupt.args else 130)
        finally:
            self._stopped.set()
            threads.shutdown()
            self._progress.close()
        if self._cannot_write is not None:
            error, total = self._cannot_write, len(self.names)
            if self.only_scene:
                raise error
            raise InputError(
                f"{error.path}: cannot be written ({error.reason}); stopped after {self._written} "
                f"of {total} scenes; free space or choose another place, then run the command again"
            ) from error
        return {scene: self._failed[scene] for scene in self.names if scene in self._failed}

    def _run_on(self, device: jax.Device, first: Path) -> None:
        """Estimate one scene after the other on a device, until none remains."""
        reading_thread, writing_thread = ThreadPoolExecutor(1), ThreadPoolExecutor(1)

        def read_next() -> tuple[Path, Future[ReadScene]] | None:
            with self._lock:
                scene = None if self._stopped.is_set() else next(self._remaining, None)
            return None if scene is None else (scene, reading_thread.submit(read, scene))

        def read(scene: Path) -> ReadScene:
            with jax.default_device(device):  # a setting of each thread
                return self._read(scene)

        try:
            following: tuple[Path, Future[ReadScene]] | None
            following = first, reading_thread.submit(read, first)
            while following is not None and not self._stopped.is_set():
                scene, reading = following
                report_phase = phase_reporter(self._progress, self.names[scene])
                result: tuple[Estimate, LightField, dict[str, Any]] | Exception
                try:
                    report_phase("reading")
                    try:
                        light_field, settings, warned, seconds = reading.result()
                    finally:
                        following = read_next()
                    for message in warned:
                        print_warning(message)
                    with jax.default_device(device):
                        estimate = run_estimator(
                            self.estimator,
                            light_field,
                            disparity_range=self.disparity_range,
                            occlusion="occlusion" in self.options.save,
                            report_phase=report_phase,
                        )
                        if self.all_views:
                            estimate = self._with_all_views(estimate, light_field, report_phase)
                    estimate = dataclasses.replace(
                        estimate,
                        seconds={"load": seconds, **estimate.seconds},
                        notes=(*warned, *estimate.notes),
                    )
                    result = estimate, light_field, settings
                except FAILURES as error:
                    result = error
                report_phase("failed" if isinstance(result, Exception) else "writing")
                if device in self._writing:
                    self._writing[device].result()
                if not self._stopped.is_set():
                    self._writing[device] = writing_thread.submit(self._finish, scene, result)
            if device in self._writing:
                self._writing[device].result()
        finally:
            reading_thread.shutdown(cancel_futures=True)
            writing_thread.shutdown(cancel_futures=True)

    def _with_all_views(
        self, estimate: Estimate, light_field: LightField, report_phase: ReportPhase
    ) -> Estimate:
        """Add the maps of all views."""
        begin = time.perf_counter()
        views = estimate_all_views(
            self.estimator,
            light_field,
            disparity_range=self.disparity_range,
            report_phase=report_phase,
        )
        seconds = {**estimate.seconds, "all views": time.perf_counter() - begin}
        return dataclasses.replace(estimate, views=views, seconds=seconds)

    def _read(self, scene: Path) -> ReadScene:
        """Read a scene."""
        begin = time.perf_counter()
        # Before its files are read: if they change then, the next call estimates the scene again.
        settings = self.settings(scene)
        with collect_warnings() as messages:
            light_field = self.reader(scene)
        calibration = self.camera.calibration(light_field.calibration)
        light_field = dataclasses.replace(light_field, calibration=calibration)
        if self.view is not None:
            light_field = with_report(light_field).around(self.view)
        return ReadScene(light_field, settings, messages, time.perf_counter() - begin)

    def _finish(
        self, scene: Path, result: tuple[Estimate, LightField, dict[str, Any]] | Exception
    ) -> None:
        """Write and report an estimate, or report why there is none."""
        name = self.names[scene]
        try:
            if isinstance(result, Exception):
                raise result
            estimate, light_field, settings = result
            outputs = write_outputs(
                estimate,
                light_field,
                self.folder / name,
                self.options,
                command=command_line(),
                settings=settings,
            )
            tqdm.write(report(name, estimate, outputs))
            self._written += 1
        except CannotWriteError as error:
            self._cannot_write = error
            self._stopped.set()
        except FAILURES as error:
            if self.only_scene:
                raise
            # Only the message of an InputError is written for users.
            kind = "" if isinstance(error, InputError) else f"{scene}: {type(error).__name__}: "
            self._failed[scene] = f"{kind}{error}"
            tqdm.write(f"occjax: {kind}{error}", file=sys.stderr)
        self._progress.update()

    def _abandon(self, code: int) -> NoReturn:
        """End the process without waiting for programs that are compiled or run."""
        self._stopped.set()
        wait(list(self._writing.values()), timeout=MAX_SECONDS_TO_FINISH_WRITING)
        self._progress.close()
        with suppress(OSError):
            print(
                f"occjax: interrupted after {self._written} of {len(self.names)} scenes; the same "
                "command estimates the others",
                file=sys.stderr,
                flush=True,
            )
            sys.stdout.flush()
        os._exit(code)


@contextmanager
def _termination_as_interrupt() -> Iterator[None]:
    """Let SIGTERM interrupt the main thread like Ctrl-C."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(*_: object) -> NoReturn:
        raise KeyboardInterrupt("SIGTERM")

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _report_skipped(skipped: int, shared: list[Path], names: dict[Path, str]) -> None:
    """Say how many scenes are not estimated because their results are complete."""
    if skipped:
        what = names[shared[0]] if len(names) == 1 else f"{skipped} of {len(shared)} scenes"
        verb = "is" if skipped == 1 else "are"
        print(
            f"{what} {verb} complete with the same settings and skipped; pass --overwrite to "
            "estimate again"
        )


def _write_video(folder: Path, rows: list[Row], frames_per_second: float) -> None:
    """Write the video of all frames; one that failed shows the one before."""
    places: list[Path] = []
    for entry in rows:
        if entry["error"] is None:
            places.append(folder / entry["scene"])
        elif places:
            places.append(places[-1])
    if places:
        path = folder / "disparity.mp4"
        write_disparity_video(path, places, frames_per_second=frames_per_second)
        print(f"video: {len(places)} frames written to {path}")


def _frame_names(scenes: tuple[Path, ...]) -> dict[Path, str]:
    """Number the frames of a video, with zeros in front."""
    digits = max(4, len(str(len(scenes) - 1)))
    return {scene: f"{number:0{digits}}" for number, scene in enumerate(scenes)}


def _write_report(path: Path, folders: tuple[Path, ...]) -> None:
    """Write the page on folders of results, if there are any."""
    if folders:
        from occjax.report.page import write_report
        from occjax.report.scenes import read_scenes

        write_report(path, read_scenes(folders))
        print(f"report: {path}")


def folder_names(scenes: tuple[Path, ...]) -> dict[Path, str]:
    """Name a folder after each scene, and after its parents where two names would collide."""
    names: dict[Path, str] = {}
    seen = set()
    for scene in scenes:
        if scene.resolve() in seen:
            continue
        seen.add(scene.resolve())
        place = Path(os.path.abspath(scene))  # a link keeps its own name
        own = (place.stem if place.is_file() else place.name) or "root"
        candidates = [own, place.name.replace(".", "_")]
        parents = place.parts[1:-1]
        candidates += ["_".join([*parents[-depth:], own]) for depth in range(1, len(parents) + 1)]
        candidates += [f"{own}_{number}" for number in range(2, len(scenes) + 2)]
        names[scene] = next(name for name in candidates if name and name not in names.values())
    return names


def phase_reporter(progress: tqdm | None, name: str) -> Callable[[str], None]:
    """Return a function that shows the current phase on the progress bar or on its own line.

    On a terminal the line is replaced by that of the next phase; in a pipe or a file each phase
    adds a line.
    """

    def show(phase: str) -> None:
        if progress is not None and not progress.disable:
            progress.set_description(f"{name}: {phase}")
        elif sys.stderr.isatty():
            print(f"\r\033[K{name}: {phase} ...", end="", file=sys.stderr, flush=True)
            if phase in ("writing", "failed"):
                print("\r\033[K", end="", file=sys.stderr, flush=True)
        elif phase != "failed":  # The error is printed too.
            print(f"{name}: {phase}", file=sys.stderr, flush=True)

    return show


def report(name: str, estimate: Estimate, outputs: Outputs) -> str:
    """Return the report on a finished scene."""
    low, high = estimate.disparity_range
    lines = [
        f"{name}: {estimate.model}"
        + (f" with {estimate.weights}" if estimate.weights else "")
        + f", disparity searched in [{low:.2f}, {high:.2f}], "
        + ", ".join(f"{phase} {value:.1f} s" for phase, value in estimate.seconds.items())
    ]
    lines += [f"  note: {note}" for note in outputs.notes]
    if outputs.metrics is not None:
        lines += [f"  {line}" for line in outputs.metrics.table().splitlines()]
    parts = (path.relative_to(outputs.folder).parts for path in outputs.paths)
    names = dict.fromkeys(first + "/" * bool(rest) for first, *rest in parts)
    lines.append(f"  written to {outputs.folder}: {', '.join(names)}")
    return "\n".join(lines)
