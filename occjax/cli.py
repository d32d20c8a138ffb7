"""The command line: parse, call the library, print.

Exit codes: 0 all went well; 1 some of several scenes failed; 2 the input cannot be used.
"""

from __future__ import annotations

import dataclasses
import json
import os
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import jax
import platformdirs
from tqdm import tqdm
from tyro.conf import OmitArgPrefixes, Positional, arg
from tyro.extras import SubcommandApp

import occjax
from occjax.errors import InputError
from occjax.evaluation import BORDER, THRESHOLDS, evaluate_files
from occjax.inference import MODELS, Estimate, Estimator
from occjax.inference.estimate import Precision
from occjax.inference.outputs import Outputs, write_outputs
from occjax.io import Layout, Orientation, OrientationReport, check, load
from occjax.io.atomic import check_writable
from occjax.io.orientation import declared_orientation
from occjax.lightfield import LightField
from occjax.models.config import Warp
from occjax.models.fetch import fetch_published_weights

app = SubcommandApp()
weights_app = SubcommandApp()
app.command(weights_app, name="weights", help="Weights of the networks.")


def _option(help: str, metavar: str) -> Any:
    """An option that may be left out; ``None`` means nothing to a user."""
    return arg(help=help, metavar=metavar, help_behavior_hint="")


@dataclasses.dataclass(frozen=True)
class Stored:
    """How a light field is stored, where that is not found out."""

    layout: Annotated[
        str | None, _option(f"How the views are stored: {', '.join(get_args(Layout))}.", "LAYOUT")
    ] = None
    pattern: Annotated[
        str | None, _option("File names of the views, with {v} and {u} or {i} in them.", "PATTERN")
    ] = None
    grid: Annotated[
        tuple[int, int] | None, _option("Rows and columns of views as stored.", "V U")
    ] = None
    key: Annotated[str | None, _option("Name of the views in an .npz.", "NAME")] = None
    order: Annotated[
        Literal["vu", "uv"], arg(help="vu if the files count rows first, uv if columns.")
    ] = "vu"
    flip: Annotated[
        str,
        _option("Axes of the grid that run backwards in the files: v, u or vu.", "AXES"),
    ] = ""

    def load(self, path: Path, **options) -> LightField:
        """Read a light field that is stored this way."""
        return load(path, **dataclasses.asdict(self), **options)


@app.command(name="estimate")
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
        Path, arg(aliases=["-o"], metavar="FOLDER", help="Results go to FOLDER/<scene>/.")
    ],
    model: Annotated[
        str | None,
        _option(
            "photometric, which needs no weights, or a network of the paper: "
            f"{', '.join(MODELS[1:])}. By default the one the weights were made for.",
            "MODEL",
        ),
    ] = None,
    weights: Annotated[
        Path | None, _option("Weights: .safetensors, or the published .h5 / .hdf5.", "FILE")
    ] = None,
    warp: Annotated[
        Warp | None, _option("correct or transposed, if not the weights' own.", "WARP")
    ] = None,
    disparity_range: Annotated[
        tuple[float, float] | None,
        _option("Disparities to search, in pixels per view step.", "MIN MAX"),
    ] = None,
    precision: Annotated[Precision, arg(help="Type of a network's convolutions.")] = "float32",
    stored: OmitArgPrefixes[Stored] = Stored(),
) -> int:
    """Estimate disparity maps and write them, with pictures, to a folder per scene."""
    if not scenes:
        raise InputError("name at least one scene: a folder of views, an image or an array file")
    estimator = Estimator(model, weights=weights, warp=warp, precision=precision)
    names = _folder_names(scenes)
    check_writable(output)
    failed = []
    progress = tqdm(names, unit="scene", disable=len(names) == 1 or None, leave=False)
    for scene in progress:
        say = _phase_reporter(progress, names[scene])
        try:
            say("reading")
            light_field, seconds, warned = _timed_load(stored, scene)
            estimate = estimator(light_field, disparity_range=disparity_range, say=say)
            estimate = dataclasses.replace(
                estimate,
                seconds={"load": seconds, **estimate.seconds},
                notes=(*warned, *estimate.notes),
            )
            say("writing")
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


@app.command(name="evaluate")
def evaluate_command(
    estimate: Positional[Annotated[Path, arg(help="Disparity map, PFM or NPY.")]],
    ground_truth: Positional[Annotated[Path, arg(help="True disparity, PFM or NPY.")]],
    thresholds: Annotated[
        tuple[float, ...], arg(help="BadPix thresholds, in pixels per view step.")
    ] = THRESHOLDS,
    border: Annotated[int, arg(help="Pixels left out at each side.")] = BORDER,
    json_: Annotated[bool, arg(name="json", help="Print JSON.")] = False,
) -> int:
    """Compare a disparity map with the ground truth."""
    metrics = evaluate_files(estimate, ground_truth, thresholds=thresholds, border=border)
    print(json.dumps(metrics.as_dict(), indent=2) if json_ else metrics.table())
    return 0


@app.command(name="check")
def check_command(
    path: Positional[
        Annotated[Path, arg(help="Folder of views, image of all views, or array file.")]
    ],
    stored: OmitArgPrefixes[Stored] = Stored(),
) -> int:
    """Measure which way round the grid of views is, and the scene's disparity range."""
    light_field = stored.load(path, check_orientation=False)
    v, u = light_field.grid
    h, w = light_field.image_size
    print(f"{light_field.name}: {v}x{u} views of {h}x{w} pixels (rows x columns)")
    print(_layout_report(check(light_field), declared_orientation(stored.order, stored.flip)))
    return 0


@app.command(name="demo")
def demo_command(
    output: Annotated[
        Path, arg(aliases=["-o"], metavar="FOLDER", help="Where the pictures go.")
    ] = Path("occjax-demo"),
) -> int:
    """Estimate the bundled sample light field and compare it with its ground truth."""
    from occjax.data.sample import sample

    light_field = sample()
    check_writable(output)
    v, u = light_field.grid
    h, w = light_field.image_size
    print(f"the bundled sample: {v}x{u} views of {h}x{w} pixels, with exact ground truth")
    estimate = Estimator()(light_field, say=_phase_reporter(None, light_field.name))
    outputs = write_outputs(estimate, light_field, output)
    print(_report(light_field.name, estimate, outputs))
    return 0


@weights_app.command(name="fetch")
def fetch_command() -> int:
    """Download the published OccCasNet weights (no licence: for your own use only)."""
    path = fetch_published_weights()
    print(f"{path}\nuse it with: occjax estimate SCENE -o FOLDER --weights {path}")
    return 0


def main() -> None:
    """Run the command line and exit with its code."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a name the terminal cannot show is no reason to fail
            stream.reconfigure(errors="backslashreplace")
    if sys.argv[1:] in (["--version"], ["-V"]):
        print(f"occjax {occjax.__version__}")
        sys.exit(0)
    _cache_compilations()
    with warnings.catch_warnings():
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = _show_warning
        sys.exit(_run())


def _run() -> int:
    """The command's exit code."""
    try:
        code = app.cli(prog="occjax", description=occjax.__doc__.splitlines()[0])
        sys.stdout.flush()
    except InputError as error:
        print(f"occjax: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of our output, head for instance, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except KeyboardInterrupt:
        print("occjax: interrupted", file=sys.stderr)
        return 130
    return code


def _cache_compilations() -> None:
    """Keep compiled programs in the user's cache, so that a second run starts at once."""
    jax.config.update("jax_compilation_cache_dir", platformdirs.user_cache_dir("occjax") + "/xla")
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


def _show_warning(message, category, filename, lineno, file=None, line=None) -> None:
    """A warning as one line, without the place in the code that means nothing to a user."""
    tqdm.write(f"occjax: warning: {message}", file=sys.stderr)


def _timed_load(stored: Stored, scene: Path) -> tuple[LightField, float, list[str]]:
    """A light field, the seconds it took, and what its reader warned of."""
    begin = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        light_field = stored.load(scene)
    for warning in caught:
        _show_warning(warning.message, warning.category, warning.filename, warning.lineno)
    return light_field, time.perf_counter() - begin, [str(warning.message) for warning in caught]


def _folder_names(scenes: tuple[Path, ...]) -> dict[Path, str]:
    """A folder for each scene, named after it, and after its parents where two would collide."""
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
    """Shows what is going on: on the progress bar, or as a line where there is none."""

    def say(phase: str) -> None:
        if progress is not None and not progress.disable:
            progress.set_description(f"{name}: {phase}")
        elif sys.stderr.isatty():
            print(f"\r\033[K{name}: {phase} ...", end="", file=sys.stderr, flush=True)
            if phase == "writing":
                print("\r\033[K", end="", file=sys.stderr, flush=True)

    return say


def _report(name: str, estimate: Estimate, outputs: Outputs) -> str:
    """What a person wants to know about a finished scene."""
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


def _layout_report(report: OrientationReport, declared: Orientation) -> str:
    """The eight layouts by their consistency, which of them is right, and the disparity range."""
    lines = [
        "",
        "  mean grey difference from the centre view at each pixel's best disparity:",
    ]
    for name, score in sorted(report.scores.items(), key=lambda item: item[1]):
        lines.append(f"    {255 * score:7.3f} / 255  {name}{' *' * (name == report.best.name)}")
    lines.append("")
    right = declared.then(report.best)
    if report.clearly_worse:
        flip = f" --flip {right.flip}" if right.flip else ""
        lines.append(f"layout: {report.best.name}; pass --order {right.order}{flip}")
    elif report.conclusive:
        lines.append("layout: as declared")
    else:
        lines.append(
            "layout: cannot tell, none is clearly more consistent than the others; are grid and "
            "layout right?"
            if not report.fits
            else "layout: cannot tell, too little texture or disparity"
        )
    if report.nearer_in_front is not None:
        share = f"{report.nearer_in_front:.0%}"
        lines.append(f"  in {share} of the occlusions the nearer surface is in front")
    if report.conclusive and not report.sign_known:
        lines.append(
            "  too few occlusions to tell the sign of disparity: with rows and columns flipped "
            "besides,\n  the views would be as consistent"
        )
    low, high = report.disparity_range
    source = f"from {report.measured:.0%} of the pixels" if report.measured else "nothing measured"
    lines.append(f"disparity: {low:.2f} to {high:.2f} pixels per view step ({source})")
    return "\n".join(lines)
