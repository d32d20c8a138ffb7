"""Create a submission to the HCI 4D benchmark, or validate one.

    python -m experiments.submit make HCI -o submission.zip
    python -m experiments.submit make HCI -o submission.zip --weights FILE
    python -m experiments.submit make -o trial.zip --small         (a minute)
    python -m experiments.submit validate submission.zip

HCI is a folder with the benchmark's unpacked archives. Cost of ``make``: about ten seconds a scene
on two cores with the proposal network; the paper's network needs a GPU. Expected: the zip file,
which is validated, and a folder of the same name with the maps and runtimes. The same command again
resumes from this folder; its ``disp_maps`` is an input of ``benchmark_table``.

The runtime of a scene is that of the estimate, from the views in memory to the disparity map in
memory. It excludes files and compilation, which happens once for all scenes of one size and
disparity range. As the benchmark demands, one model with one set of parameters estimates all
scenes, from the views and the disparity range in ``parameters.cfg``; ground truth and masks are not
used.

``validate`` prints one line for each fault of a submission and exits with code 1 if there is one.
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
from experiments.command_line import Command, Small, announce_smoke_test, main
from experiments.cut_outs import SMALL_SIZE_PX, cut_out
from experiments.hci_scenes import check_names, scene_folders
from experiments.submission import (
    SCENES,
    SIZE,
    check_submission,
    map_name,
    runtime_name,
    write_submission,
)
from occjax.cli.options import option
from occjax.data.bundled_sample import sample
from occjax.errors import InputError
from occjax.estimators import Estimator, make_estimator, run_estimator
from occjax.estimators.factory import Precision
from occjax.io import atomic_path, read_pfm, write_pfm
from occjax.io.atomic import check_writable
from occjax.io.files import decoding
from occjax.io.run_folder import read_description
from occjax.lightfield import LightField
from occjax.models import PRESETS
from occjax.models.bundled import find_weights
from occjax.models.occcasnet.config import Warp

SETTINGS = "settings.json"
"""File in the folder of maps with the settings that they were made with."""


def make(
    output: Annotated[Path, arg(aliases=["-o"], metavar="FILE.zip", help="The submission.")],
    folder: Positional[
        Annotated[Path | None, option("Folder of the benchmark's scenes.", "HCI")]
    ] = None,
    model: Annotated[str | None, option(f"One of {', '.join(PRESETS)}.", "MODEL")] = None,
    weights: Annotated[Path | None, option("Weights, as in occjax estimate.", "FILE")] = None,
    warp: Annotated[Warp | None, option("correct or transposed.", "WARP")] = None,
    precision: Annotated[Precision, arg(help="Number type of convolutions.")] = "float32",
    scenes: Annotated[
        tuple[str, ...], option("Some of the scenes, for a trial.", "SCENE...")
    ] = SCENES,
    small: Small = False,
) -> int:
    """Estimate the scenes and zip maps and runtimes; a smoke test takes parts of the sample."""
    if not scenes:
        raise InputError(f"--scenes has no names; they are {', '.join(SCENES)}")
    check_names(scenes)
    if output.suffix.lower() != ".zip":
        raise InputError(f"{output}: a submission is a zip file; choose a name that ends with .zip")
    if (folder is None) != small:
        raise InputError("name the folder of the benchmark's scenes, or pass --small alone")
    if small:
        announce_smoke_test()
    places = {} if folder is None else scene_folders(folder, scenes)
    estimator = make_estimator(model, weights=weights, warp=warp, precision=precision)
    done = output.with_suffix("")
    settings = _settings(estimator, weights, warp, precision, folder)
    _open_folder(done, settings)
    for scene in (progress := tqdm(scenes, unit="scene", disable=None)):
        if (done / map_name(scene)).is_file() and (done / runtime_name(scene)).is_file():
            continue
        progress.set_description(scene)
        estimate = run_estimator(estimator, _light_field(scene, places))
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
        print(
            f"{output}: {len(scenes)} scenes of {height}x{width} pixels, an incomplete submission"
        )
        return _report(output, check_submission(output, scenes=scenes, size=(height, width)))
    return validate(output)


def validate(
    submission: Positional[Annotated[Path, arg(metavar="SUBMISSION.zip", help="The submission.")]],
) -> int:
    """Validate a submission: one line for each fault, exit code 1 if there is one."""
    findings = check_submission(submission)
    if not findings:
        height, width = SIZE
        print(
            f"{submission}: valid, {len(SCENES)} disparity maps of {height}x{width} pixels and "
            "their runtimes"
        )
    return _report(submission, findings)


def _report(submission: Path, findings: tuple[str, ...]) -> int:
    for finding in findings:
        print(finding)
    return 1 if findings else 0


def _settings(
    estimator: Estimator,
    weights: Path | None,
    warp: str | None,
    precision: str,
    folder: Path | None,
) -> dict[str, Any]:
    """Return all settings that the maps depend on."""
    file = None if weights is None else find_weights(weights)
    return {
        "model": estimator.name,
        "weights": estimator.weights,
        "sha256": None if file is None else hashlib.sha256(file.read_bytes()).hexdigest(),
        "warp": warp,
        "precision": precision,
        "scenes from": None if folder is None else str(folder.resolve()),
        "occjax": occjax.__version__,
    }


def _open_folder(folder: Path, settings: Mapping[str, Any]) -> None:
    """Create a folder of maps, or verify that an existing one has the same settings."""
    check_writable(folder)
    path = folder / SETTINGS
    if not path.is_file():
        if folder.exists() and any(folder.iterdir()):
            raise InputError(
                f"{folder}: exists with other content; remove it, or choose another name for the "
                "zip file"
            )
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(settings, indent=2) + "\n", encoding="utf-8")
        return
    before = read_description(path)
    changed = [name for name, value in settings.items() if before.get(name) != value]
    if changed:
        raise InputError(
            f"{folder}: was made with another {', '.join(changed)}; remove it, or choose another "
            "name for the zip file"
        )


def _seconds(path: Path) -> float:
    remedy = "remove it to estimate the scene again"
    with decoding(path, "a number of seconds", remedy=remedy, max_bytes=2**10) as file:
        return float(file.read())


def _light_field(scene: str, places: Mapping[str, Path]) -> LightField:
    """Return the views of a scene without its ground truth, which a submission may not use."""
    if places:
        light_field = occjax.load(places[scene])
    else:
        row, column = divmod(SCENES.index(scene), 4)
        light_field = cut_out(
            sample(), SMALL_SIZE_PX, (row * SMALL_SIZE_PX, column * SMALL_SIZE_PX)
        )
    return dataclasses.replace(light_field, ground_truth=None)


COMMANDS: Mapping[str, Command] = {"make": make, "validate": validate}


if __name__ == "__main__":
    main(COMMANDS, __doc__)
