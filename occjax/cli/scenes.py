"""Estimate several scenes; reading, estimating and writing overlap.

While one scene is estimated, a thread reads the next one, and another thread writes the results of
the one before. Each thread is at most one scene ahead or behind, which bounds the memory. The
writing thread also prints, so that reports and errors appear in the order of the scenes.
"""

from __future__ import annotations

import dataclasses
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from tqdm import tqdm

from occjax.cli.options import CameraOptions, ViewOrderOptions
from occjax.cli.running import collect_warnings, command_line, print_warning
from occjax.errors import InputError
from occjax.estimators import Estimate, Estimator, run_estimator
from occjax.estimators.protocol import DisparityRange
from occjax.lightfield import LightField
from occjax.results.outputs import OutputOptions, Outputs, write_outputs
from occjax.results.summary import SUMMARY, read_summary

if TYPE_CHECKING:
    from occjax.report.scenes import ReportScene

FAILURES = (InputError, MemoryError, OSError, ValueError, RuntimeError)
"""Errors of one scene, which do not stop the others."""


class ReadScene(NamedTuple):
    """A light field, the warnings of its reader, and the seconds that it took."""

    light_field: LightField
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
    *,
    html: Path | None = None,
) -> int:
    """Estimate scenes and write the results of each to a folder of its own.

    Args:
        scenes: Files or folders of the light fields.
        folder: Folder in which the folders are made.
        estimator: The estimator.
        view_order: How the light fields are stored.
        camera: Camera parameters, in place of those of the files.
        disparity_range: Range to search, or None.
        options: What is written.
        html: File of a report on all scenes, or None.

    Returns:
        The exit code: 1 if a scene failed.

    Raises:
        InputError: If the only scene fails; likewise the other errors of :data:`FAILURES`.
    """
    names = folder_names(scenes)
    remaining = iter(names)
    failed: list[Path] = []
    reported: list[ReportScene] = []
    reader, writer = ThreadPoolExecutor(1), ThreadPoolExecutor(1)

    def read_next() -> Future[ReadScene] | None:
        scene = next(remaining, None)
        return None if scene is None else reader.submit(_read, scene, view_order, camera)

    def finish(scene: Path, result: tuple[Estimate, LightField] | Exception) -> None:
        try:
            if isinstance(result, Exception):
                raise result
            place = folder / names[scene]
            outputs = write_outputs(*result, place, options, command=command_line())
            if html is not None:
                from occjax.report.scenes import report_scene

                reported.append(report_scene(result[0], read_summary(place / SUMMARY)))
            tqdm.write(report(names[scene], result[0], outputs))
        except FAILURES as error:
            if len(names) == 1:
                raise
            failed.append(scene)
            # Only the message of an InputError is written for users.
            kind = "" if isinstance(error, InputError) else f"{scene}: {type(error).__name__}: "
            tqdm.write(f"occjax: {kind}{error}", file=sys.stderr)

    try:
        reading, writing = read_next(), None
        progress = tqdm(names, unit="scene", disable=len(names) == 1 or None, leave=False)
        for scene in progress:
            report_phase = phase_reporter(progress, names[scene])
            result: tuple[Estimate, LightField] | Exception
            try:
                report_phase("reading")
                assert reading is not None
                current = reading
                try:
                    light_field, warned, seconds = current.result()
                finally:
                    reading = read_next()
                for message in warned:
                    print_warning(message)
                estimate = run_estimator(
                    estimator,
                    light_field,
                    disparity_range=disparity_range,
                    occlusion="occlusion" in options.save or html is not None,
                    report_phase=report_phase,
                )
                estimate = dataclasses.replace(
                    estimate,
                    seconds={"load": seconds, **estimate.seconds},
                    notes=(*warned, *estimate.notes),
                )
                result = estimate, light_field
            except FAILURES as error:
                result = error
            report_phase("failed" if isinstance(result, Exception) else "writing")
            if writing is not None:
                writing.result()
            writing = writer.submit(finish, scene, result)
        if writing is not None:
            writing.result()
    finally:
        reader.shutdown(cancel_futures=True)
        writer.shutdown(cancel_futures=True)
    if reported:
        from occjax.report.page import write_report

        assert html is not None
        write_report(html, reported)
        print(f"report: {html}")
    if failed:
        listed = ", ".join(str(scene) for scene in failed)
        print(f"occjax: {len(failed)} of {len(names)} scenes failed: {listed}", file=sys.stderr)
    return 1 if failed else 0


def _read(scene: Path, view_order: ViewOrderOptions, camera: CameraOptions) -> ReadScene:
    begin = time.perf_counter()
    with collect_warnings() as messages:
        light_field = view_order.load(scene)
    calibration = camera.calibration(light_field.calibration)
    light_field = dataclasses.replace(light_field, calibration=calibration)
    return ReadScene(light_field, messages, time.perf_counter() - begin)


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
    lines.append(f"  written to {outputs.folder}: {', '.join(p.name for p in outputs.paths)}")
    return "\n".join(lines)
