"""Make a submission to the HCI 4D benchmark, or check one.

    python -m experiments.submit make HCI -o submission.zip
    python -m experiments.submit make HCI -o submission.zip --weights FILE
    python -m experiments.submit make -o trial.zip --small         (a minute, no download)
    python -m experiments.submit validate submission.zip

HCI is a folder with the twelve scenes, as the benchmark's archives unpack. Cost of ``make`` on two
cores: about ten seconds a scene with the light network; with weights of the paper's network, which
is made for a GPU, many minutes. What is done lies beside the zip, in a folder of its name, and the
same command again goes on from there; ``disp_maps`` in it is what ``benchmark_table`` takes.

The runtime of a scene is the time of the estimate alone: from the views in memory to the disparity
map in memory, without reading files, without compiling, which happens once for all scenes of one
size and range of disparities, and without writing.

As the benchmark demands, one model with one set of parameters estimates all scenes, from the views
and the disparity range in ``parameters.cfg``; ground truth and masks are not looked at.

``validate`` prints one line for each fault of any submission and exits with 1, or with 0 if there
is none. A fresh submission is validated, too.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from tqdm import tqdm
from tyro.conf import Positional, arg

import occjax
from experiments.command_line import Command, main
from experiments.cut_outs import cut_out
from experiments.hci_scenes import check_names, scene_folders
from occjax.cli.options import option
from occjax.data.sample import sample
from occjax.errors import InputError
from occjax.inference import MODELS, Estimator
from occjax.inference.estimate import Precision
from occjax.io import atomic_path, check_submission, read_pfm, write_pfm, write_submission
from occjax.io.atomic import check_writable
from occjax.io.files import reading
from occjax.io.submission import SCENES, SIZE, map_name, runtime_name
from occjax.lightfield import LightField
from occjax.models.bundled import find_weights
from occjax.models.config import Warp

SMALL = 64
"""Side of the cut-outs of the small form, in pixels."""

SETTINGS = "settings.json"
"""In the folder of what is done: what it was made with."""


def make(
    output: Annotated[Path, arg(aliases=["-o"], metavar="FILE.zip", help="The submission.")],
    folder: Positional[
        Annotated[Path | None, option("Folder of the benchmark's scenes.", "HCI")]
    ] = None,
    model: Annotated[str | None, option(f"One of {', '.join(MODELS)}.", "MODEL")] = None,
    weights: Annotated[Path | None, option("Weights, as of occjax estimate.", "FILE")] = None,
    warp: Annotated[Warp | None, option("correct or transposed.", "WARP")] = None,
    precision: Annotated[Precision, arg(help="Type of a network's convolutions.")] = "float32",
    scenes: Annotated[tuple[str, ...], option("Some of the scenes, to try.", "SCENE...")] = SCENES,
    small: Annotated[
        bool, arg(help="The middle of each scene; without HCI, cut-outs of the bundled sample.")
    ] = False,
) -> int:
    """Estimate the scenes of the benchmark and zip the maps and runtimes."""
    if not scenes:
        raise InputError(f"name some scenes, or leave out --scenes; they are {', '.join(SCENES)}")
    check_names(scenes)
    if output.suffix.lower() != ".zip":
        raise InputError(f"{output}: a submission is a zip; choose a name that ends with .zip")
    if folder is None and not small:
        raise InputError("name the folder of the benchmark's scenes, or try with --small")
    places = {} if folder is None else scene_folders(folder, scenes)
    estimator = Estimator(model, weights=weights, warp=warp, precision=precision)
    done = output.with_suffix("")
    _begin(done, _settings(estimator, weights, precision, folder, small))
    for scene in (progress := tqdm(scenes, unit="scene", disable=None)):
        if (done / map_name(scene)).is_file() and (done / runtime_name(scene)).is_file():
            continue
        progress.set_description(scene)
        light_field = _light_field(scene, places, small)
        estimate = estimator(light_field)
        with atomic_path(done / runtime_name(scene)) as temporary:
            temporary.write_text(f"{estimate.seconds['run']:.6g}\n", encoding="ascii")
        write_pfm(done / map_name(scene), estimate.disparity)
    maps = {scene: read_pfm(done / map_name(scene)) for scene in scenes}
    seconds = {scene: _seconds(done / runtime_name(scene)) for scene in scenes}
    write_submission(output, maps, seconds)
    for scene in scenes:
        print(f"{scene:<12}{seconds[scene]:9.2f} s")
    if small or set(scenes) != set(SCENES):
        height, width = maps[scenes[0]].shape
        print(f"{output}: {len(scenes)} scenes of {height}x{width} pixels, no full submission")
        return _tell(output, check_submission(output, scenes=scenes, size=(height, width)))
    return validate(output)


def validate(
    submission: Positional[Annotated[Path, arg(metavar="SUBMISSION.zip", help="Whoever's.")]],
) -> int:
    """Check a submission: one line for each fault, exit code 1 if there are any."""
    findings = check_submission(submission)
    if not findings:
        height, width = SIZE
        print(
            f"{submission}: fine, {len(SCENES)} disparity maps of {height}x{width} pixels and "
            "their runtimes"
        )
    return _tell(submission, findings)


def _tell(submission: Path, findings: tuple[str, ...]) -> int:
    for finding in findings:
        print(finding)
    return 1 if findings else 0


def _settings(
    estimator: Estimator, weights: Path | None, precision: str, folder: Path | None, small: bool
) -> dict[str, Any]:
    """All that the maps depend on."""
    file = None if weights is None else find_weights(weights)
    return {
        "model": estimator.model,
        "weights": estimator.weights,
        "sha256": None if file is None else hashlib.sha256(file.read_bytes()).hexdigest(),
        "warp": getattr(estimator.config, "warp", None),
        "precision": precision,
        "scenes from": None if folder is None else str(folder.resolve()),
        "small": small,
        "occjax": occjax.__version__,
    }


def _begin(folder: Path, settings: Mapping[str, Any]) -> None:
    """Begin a folder of maps, or go on with one that was begun with the same settings."""
    check_writable(folder)
    path = folder / SETTINGS
    if not path.is_file():
        if folder.exists() and any(folder.iterdir()):
            raise InputError(
                f"{folder}: is there already, with other things in it; remove it, or "
                "choose another name for the zip"
            )
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(settings, indent=2) + "\n", encoding="utf-8")
        return
    with reading(path):
        text = path.read_text(encoding="utf-8", errors="replace")
    try:
        before = json.loads(text)
    except ValueError:
        before = {}
    changed = [name for name, value in settings.items() if before.get(name) != value]
    if changed:
        raise InputError(
            f"{folder}: was made with another {', '.join(changed)}; remove it, or choose another "
            "name for the zip"
        )


def _seconds(path: Path) -> float:
    with reading(path):
        text = path.read_text(encoding="ascii", errors="replace")
    try:
        return float(text)
    except ValueError:
        message = f"{path}: reads {text[:20]!r}, not seconds; remove it to estimate the scene again"
        raise InputError(message) from None


def _light_field(scene: str, places: Mapping[str, Path], small: bool) -> LightField:
    """Views of a scene, without anything that a submission may not use."""
    if not places:
        row, column = divmod(SCENES.index(scene), 4)
        part = cut_out(sample(), SMALL, (row * SMALL, column * SMALL))
        return dataclasses.replace(part, ground_truth=None)
    light_field = dataclasses.replace(occjax.load(places[scene]), ground_truth=None)
    return cut_out(light_field, SMALL) if small else light_field


COMMANDS: Mapping[str, Command] = {"make": make, "validate": validate}


if __name__ == "__main__":
    main(COMMANDS, __doc__)
