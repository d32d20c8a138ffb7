"""The commands ``estimate`` and ``demo``."""

from __future__ import annotations

import dataclasses
import os
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from tqdm import tqdm
from tyro.conf import OmitArgPrefixes, Positional, arg

from occjax.cli.options import CameraOptions, ViewOrderOptions, option, pair
from occjax.cli.running import show_warning
from occjax.errors import InputError
from occjax.estimators import Estimate, make_estimator, run_estimator
from occjax.estimators.factory import Precision
from occjax.io.atomic import check_writable
from occjax.lightfield import LightField
from occjax.models.bundled import ready_models
from occjax.models.occcasnet.config import Warp
from occjax.results.outputs import Outputs, write_outputs


def estimate_command(
    scenes: Positional[
        Annotated[
            tuple[Path, ...],
            arg(
                metavar="SCENE...",
                help="Folders of views, images of all views, or array files.",
                help_behavior_hint="",
            ),
        ]
    ],
    output: Annotated[
        Path, arg(aliases=["-o"], metavar="FOLDER", help="Results are written to FOLDER/<scene>/.")
    ],
    model: Annotated[
        str | None,
        option(
            f"{' or '.join(ready_models())}; any other name from 'occjax weights list' needs "
            "--weights. By default the model of the weights.",
            "MODEL",
        ),
    ] = None,
    weights: Annotated[
        Path | None,
        option(
            "Weights: .safetensors, the published .h5 / .hdf5, or a name from 'occjax weights "
            "list'. By default the first in that list.",
            "FILE",
        ),
    ] = None,
    warp: Annotated[
        Warp | None, option("correct or transposed, instead of the warp of the weights.", "WARP")
    ] = None,
    disparity_range: Annotated[
        tuple[float, float] | None,
        pair(float),
        option("Disparities to search, in pixels per view step.", "MIN MAX"),
    ] = None,
    precision: Annotated[Precision, arg(help="Type of a network's convolutions.")] = "float32",
    camera: OmitArgPrefixes[CameraOptions] = CameraOptions(),
    view_order: OmitArgPrefixes[ViewOrderOptions] = ViewOrderOptions(),
) -> int:
    """Estimate disparity maps and write them, with pictures, to one folder per scene."""
    if not scenes:
        raise InputError("pass at least one scene: a folder of views, an image or an array file")
    estimator = make_estimator(model, weights=weights, warp=warp, precision=precision)
    names = _folder_names(scenes)
    check_writable(output)
    failed = []
    progress = tqdm(names, unit="scene", disable=len(names) == 1 or None, leave=False)
    for scene in progress:
        report_phase = _phase_reporter(progress, names[scene])
        try:
            report_phase("reading")
            light_field, seconds, warned = _timed_load(view_order, scene)
            calibration = camera.calibration(light_field.calibration)
            light_field = dataclasses.replace(light_field, calibration=calibration)
            estimate = run_estimator(
                estimator,
                light_field,
                disparity_range=disparity_range,
                occlusion=True,
                report_phase=report_phase,
            )
            estimate = dataclasses.replace(
                estimate,
                seconds={"load": seconds, **estimate.seconds},
                notes=(*warned, *estimate.notes),
            )
            report_phase("writing")
            outputs = write_outputs(estimate, light_field, output / names[scene])
        except (InputError, MemoryError, OSError, ValueError, RuntimeError) as error:
            if len(names) == 1:
                raise
            failed.append(scene)
            # Only the message of an InputError is written for users.
            kind = "" if isinstance(error, InputError) else f"{scene}: {type(error).__name__}: "
            tqdm.write(f"occjax: {kind}{error}", file=sys.stderr)
        else:
            tqdm.write(_report(names[scene], estimate, outputs))
    if failed:
        listed = ", ".join(str(scene) for scene in failed)
        print(f"occjax: {len(failed)} of {len(names)} scenes failed: {listed}", file=sys.stderr)
    return 1 if failed else 0


def demo_command(
    output: Annotated[
        Path, arg(aliases=["-o"], metavar="FOLDER", help="Folder of the results.")
    ] = Path("occjax-demo"),
) -> int:
    """Estimate the bundled sample light field and compare it with its ground truth."""
    from occjax.data.bundled_sample import sample

    light_field = sample()
    check_writable(output)
    v, u = light_field.grid
    h, w = light_field.image_size
    print(f"the bundled sample: {v}x{u} views of {h}x{w} pixels, with exact ground truth")
    estimate = run_estimator(
        make_estimator(),
        light_field,
        occlusion=True,
        report_phase=_phase_reporter(None, light_field.name),
    )
    outputs = write_outputs(estimate, light_field, output)
    print(_report(light_field.name, estimate, outputs))
    return 0


def _timed_load(view_order: ViewOrderOptions, scene: Path) -> tuple[LightField, float, list[str]]:
    """Read a light field; return it with the seconds it took and the reader's warnings."""
    begin = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        light_field = view_order.load(scene)
    for warning in caught:
        show_warning(warning.message, warning.category, warning.filename, warning.lineno)
    return light_field, time.perf_counter() - begin, [str(warning.message) for warning in caught]


def _folder_names(scenes: tuple[Path, ...]) -> dict[Path, str]:
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


def _phase_reporter(progress: tqdm | None, name: str) -> Callable[[str], None]:
    """Return a function that shows the current phase on the progress bar or on its own line.

    On a terminal the line is replaced by that of the next phase; in a pipe or a file each phase
    adds a line.
    """

    def report(phase: str) -> None:
        if phase == "compiling":
            phase += " (up to minutes for a new size of image, kept for later runs)"
        if progress is not None and not progress.disable:
            progress.set_description(f"{name}: {phase}")
        elif sys.stderr.isatty():
            print(f"\r\033[K{name}: {phase} ...", end="", file=sys.stderr, flush=True)
            if phase == "writing":
                print("\r\033[K", end="", file=sys.stderr, flush=True)
        else:
            print(f"{name}: {phase}", file=sys.stderr, flush=True)

    return report


def _report(name: str, estimate: Estimate, outputs: Outputs) -> str:
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
