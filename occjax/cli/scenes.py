"""Estimate scenes and write a folder of results for each."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from occjax import programs
from occjax.cli.frames import frame_reader, write_disparity_video
from occjax.cli.options import CameraOptions, ViewOrderOptions
from occjax.cli.pipelines import Pipelines
from occjax.cli.resuming import complete_summary, estimator_settings, files_sha256
from occjax.cli.running import collect_warnings, command_line, print_warning
from occjax.cli.scene_lists import folder_names, frame_names
from occjax.cli.table import Row, row, stored_failures, write_table
from occjax.errors import InputError
from occjax.estimators import Estimate, Estimator, estimate_all_views, run_estimator
from occjax.estimators.driver import with_report
from occjax.estimators.phases import ReportPhase
from occjax.estimators.protocol import DisparityRange
from occjax.io.atomic import remove_leftovers
from occjax.io.naming.patterns import is_in_subfolders
from occjax.lightfield import LightField
from occjax.results.outputs import OutputOptions, Outputs, write_outputs


@dataclasses.dataclass(frozen=True)
class EstimateRun:
    """A call of ``occjax estimate``, without its scenes.

    Attributes:
        folder: Folder in which the folders of results are made.
        estimator: The estimator.
        view_order: How the light fields are stored.
        camera: Camera parameters, in place of those of the files.
        disparity_range: Range to search, or None.
        outputs: What is written for each scene.
        overwrite: Whether scenes that are complete with the same settings are estimated again.
        share: ``(index, count)``: this process estimates every ``count``-th scene from ``index``.
        fps: Frames per second of the video whose frames are the scenes; None if the scenes are
            independent.
        view: ``(v, u)`` of the view that is estimated; None for the centre view.
        all_views: Whether the other views are estimated too.
        report: Whether ``report.html`` on all complete scenes is written.
    """

    folder: Path
    estimator: Estimator
    view_order: ViewOrderOptions
    camera: CameraOptions
    disparity_range: DisparityRange | None
    outputs: OutputOptions
    overwrite: bool
    share: tuple[int, int]
    fps: float | None
    view: tuple[int, int] | None
    all_views: bool
    report: bool


def estimate_scenes(scenes: tuple[Path, ...], run: EstimateRun) -> int:
    """Estimate scenes and write the results of each to a folder of its own.

    Of several scenes, ``scenes.csv`` and ``scenes.json`` are written too; of a video,
    ``disparity.mp4``.

    Args:
        scenes: Files or folders of the light fields, or of the frames of a video in their order.
        run: The estimator, and what is read, estimated and written.

    Returns:
        The exit code: 1 if a scene failed.

    Raises:
        InputError: If results cannot be written; then no further scene is estimated. If there is
            only one scene, its own error is raised, of any type.
    """
    folder = run.folder
    names = folder_names(scenes) if run.fps is None else frame_names(scenes)
    common_settings = estimator_settings(
        run.estimator,
        {
            **dataclasses.asdict(run.view_order),
            **dataclasses.asdict(run.camera),
            **dataclasses.asdict(run.outputs),
            "save": sorted(run.outputs.save),
            "disparity_range": run.disparity_range,
            "view": run.view,
            "all_views": run.all_views,
        },
    )
    hash_files = partial(files_sha256, nested=is_in_subfolders(run.view_order.pattern))
    if run.fps is not None:  # The first frame decides the disparity range of all frames.
        common_settings["first_frame_sha256"] = hash_files(scenes[0])

    def settings(scene: Path) -> dict[str, Any]:
        return {**common_settings, "files_sha256": hash_files(scene)}

    def stored_summary(scene: Path) -> dict[str, Any] | None:
        """Return the summary of complete results with the same settings, if there are any."""
        return complete_summary(folder / names[scene], settings(scene))

    # Killed processes leave temporary files.
    remove_leftovers(folder)
    index, count = run.share
    own = list(names)[index::count]
    for scene in own:
        remove_leftovers(folder / names[scene])
    pending = [scene for scene in own if run.overwrite or stored_summary(scene) is None]
    if skipped := len(own) - len(pending):
        what = names[own[0]] if len(names) == 1 else f"{skipped} of {len(own)} scenes"
        verb = "is" if skipped == 1 else "are"
        print(
            f"{what} {verb} complete with the same settings and skipped; pass --overwrite to "
            "estimate again"
        )
    failed: dict[Path, str] = {}
    if pending:
        programs.preload()  # while the first scene is read
        load = run.view_order.load
        reader = load if run.fps is None else frame_reader(scenes[0], run.view_order)
        steps = SceneSteps(run, reader, settings)
        failed = Pipelines(
            {scene: names[scene] for scene in pending},
            read=steps.read,
            estimate=steps.estimate,
            write=steps.write,
            single_scene=len(names) == 1,
        ).run()

    def table_rows() -> list[Row]:
        failed_elsewhere = stored_failures(folder)
        rows = []
        for scene, name in names.items():
            summary = None if scene in failed else stored_summary(scene)
            error = failed.get(scene)
            if summary is None and scene not in own:  # Another process may have tried.
                error = failed_elsewhere.get(name)
            rows.append(row(name, scene, summary, error))
        return rows

    if len(names) > 1:
        rows = write_table(folder, table_rows)
        # Of a missing frame, another process still makes the results.
        if run.fps is not None and not any(entry["state"] == "missing" for entry in rows):
            _write_video(folder, rows, run.fps)
    complete = [scene for scene in names if run.report and stored_summary(scene)]
    if complete:
        from occjax.report.page import write_report
        from occjax.report.scenes import read_scenes

        page = folder / "report.html"
        write_report(page, read_scenes(tuple(folder / names[scene] for scene in complete)))
        print(f"report: {page}")
    if failed:
        listed = ", ".join(str(scene) for scene in failed)
        print(f"occjax: {len(failed)} of {len(names)} scenes failed: {listed}", file=sys.stderr)
    return 1 if failed else 0


class _LoadedScene(NamedTuple):
    """A scene that was read.

    Attributes:
        light_field: Its light field.
        settings: All that its results depend on.
        warnings: Warnings of the reader.
        seconds: Time of reading.
    """

    light_field: LightField
    settings: dict[str, Any]
    warnings: list[str]
    seconds: float


@dataclasses.dataclass(frozen=True)
class SceneSteps:
    """The steps of each scene: read the light field, estimate it, write the results.

    Attributes:
        run: The estimator, and what is estimated and written.
        reader: Reads a light field.
        settings: Returns all that the results of a scene depend on.
    """

    run: EstimateRun
    reader: Callable[[Path], LightField]
    settings: Callable[[Path], dict[str, Any]]

    def read(self, path: Path) -> _LoadedScene:
        """Read a scene."""
        begin = time.perf_counter()
        # The settings hash the files. If a file changes while it is read, the next call estimates
        # the scene again.
        settings = self.settings(path)
        with collect_warnings() as messages:
            try:
                light_field = self.reader(path)
                calibration = self.run.camera.calibration(light_field.calibration)
                light_field = dataclasses.replace(light_field, calibration=calibration)
                if self.run.view is not None:
                    light_field = with_report(light_field).around(self.run.view)
            except InputError:  # of which a warning may be the cause, such as a damaged view
                for message in messages:
                    print_warning(message)
                raise
        return _LoadedScene(light_field, settings, messages, time.perf_counter() - begin)

    def estimate(
        self, scene: _LoadedScene, report_phase: ReportPhase
    ) -> tuple[Estimate, _LoadedScene]:
        """Estimate a scene."""
        run = self.run
        for message in scene.warnings:  # here, because reading is one scene ahead
            print_warning(message)
        estimate = run_estimator(
            run.estimator,
            scene.light_field,
            disparity_range=run.disparity_range,
            occlusion="occlusion" in run.outputs.save,
            report_phase=report_phase,
        )
        seconds = {"load": scene.seconds, **estimate.seconds}
        views = None
        if run.all_views:
            begin = time.perf_counter()
            views = estimate_all_views(
                run.estimator,
                scene.light_field,
                disparity_range=run.disparity_range,
                report_phase=report_phase,
            )
            seconds["all views"] = time.perf_counter() - begin
        notes = (*scene.warnings, *estimate.notes)
        estimate = dataclasses.replace(estimate, views=views, seconds=seconds, notes=notes)
        return estimate, scene

    def write(self, name: str, estimated: tuple[Estimate, _LoadedScene]) -> str:
        """Write the results of a scene and return the text to print on it."""
        estimate, scene = estimated
        outputs = write_outputs(
            estimate,
            scene.light_field,
            self.run.folder / name,
            self.run.outputs,
            command=command_line(),
            settings=scene.settings,
        )
        return result_text(name, estimate, outputs)


def _write_video(folder: Path, rows: list[Row], fps: float) -> None:
    """Write the video of all frames; a failed frame is replaced by the frame before it."""
    folders: list[Path] = []
    for entry in rows:
        if entry["error"] is None:
            folders.append(folder / entry["scene"])
        elif folders:
            folders.append(folders[-1])
    if folders:
        path = folder / "disparity.mp4"
        write_disparity_video(path, folders, frames_per_second=fps)
        print(f"video: {len(folders)} frames written to {path}")


def result_text(name: str, estimate: Estimate, outputs: Outputs) -> str:
    """Return the text that is printed on a finished scene."""
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
    entries = []
    for path in outputs.paths:
        first, *rest = path.relative_to(outputs.folder).parts
        entries.append(f"{first}/" if rest else first)
    lines.append(f"  written to {outputs.folder}: {', '.join(dict.fromkeys(entries))}")
    return "\n".join(lines)
