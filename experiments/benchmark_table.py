"""Scores on the twelve scenes of the HCI 4D benchmark, next to published ones (table 1).

    python -m experiments.benchmark_table > experiments/benchmark_table.md
    python -m experiments.benchmark_table NAME=FOLDER... --truth HCI -o tables
    python -m experiments.benchmark_table --small

Cost: seconds. Expected: the paper's table 1 with the same marks except one: the second best MSE on
backgammon is that of Epinet-fcn-m, not of OccCasNet. Averages are computed from the twelve scores.
Three of the paper's averages differ by more than rounding (BadPix 0.07 of OccCasNet, 0.03 of SPO,
0.01 of FastLFnet); they follow in brackets. The paper has no Q25 by scene, so that table has only
measured methods. The tables of the published methods are committed as ``benchmark_table.md``. This
library has not been measured on all scenes yet.

FOLDER contains the estimates of a method: ``<scene>.pfm``, as in ``disp_maps`` of a submission, or
result folders ``<scene>`` of ``occjax estimate``. HCI is a folder with the benchmark's unpacked
archives. Scenes without an estimate or without public ground truth (four of the twelve) have a
dash; then one more column has the average over the scenes that all measured methods have. ``-o``
writes the tables as Markdown and LaTeX. ``--small`` measures maps with known scores: the ground
truth of the bundled sample plus 0.02.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import Positional

from experiments.command_line import Small, announce_smoke_test, main
from experiments.hci_scenes import find_scene
from experiments.markdown import write_text
from experiments.published_scores import PRINTED_AVERAGE, published_scores
from experiments.score_tables import Table, latex, markdown, rounding_error
from experiments.submission import SCENES
from occjax.cli.options import option
from occjax.data.bundled_sample import sample
from occjax.errors import InputError
from occjax.evaluation import evaluate_files
from occjax.io import write_pfm
from occjax.io.hci_config import GROUND_TRUTH

TITLES = {
    "badpix_0.07": "BadPix 0.07",
    "badpix_0.03": "BadPix 0.03",
    "badpix_0.01": "BadPix 0.01",
    "mse_x100": "MSE x100",
    "q25_x100": "Q25 x100",
}
"""Title of each measure, in the paper's order."""

Scores = Mapping[str, Mapping[str, float]]
"""Scores by scene and measure."""


def run(
    methods: Positional[
        Annotated[tuple[str, ...], option("Methods to measure.", "NAME=FOLDER")]
    ] = (),
    truth: Annotated[Path | None, option("Folder of the benchmark's scenes.", "HCI")] = None,
    output: Annotated[
        Path | None, option("Folder for benchmark_table.md and .tex.", "FOLDER", "-o")
    ] = None,
    small: Small = False,
) -> None:
    """Print the tables, and write them if there is an output folder."""
    if small:
        if methods or truth:
            raise InputError("--small has its own maps; remove the methods and --truth")
        announce_smoke_test()
        measured, notes = _known()
    else:
        measured, notes = _measure_all(methods, truth)
    all_tables = tables(measured)
    if any(table.printed for table in all_tables):
        notes.insert(0, "In brackets: the paper's average, which is not that of its twelve scores.")
    print(markdown(all_tables, notes))
    if output is not None:
        write_text(output / "benchmark_table.md", markdown(all_tables, notes))
        write_text(output / "benchmark_table.tex", latex(all_tables, notes))


def measure(estimates: Path, truth: Path) -> tuple[dict[str, dict[str, float]], str]:
    """Score a method on every scene that has an estimate and ground truth.

    Args:
        estimates: Folder with ``<scene>.pfm`` or result folders ``<scene>``.
        truth: Folder of the benchmark's scenes.

    Returns:
        Scores by scene and measure, and a remark on incomplete scenes, which may be empty.

    Raises:
        InputError: If there is no estimate with ground truth, or a map is unusable.
    """
    if not estimates.is_dir():
        raise InputError(f"{estimates}: is not a folder; check the path")
    scores: dict[str, dict[str, float]] = {}
    left_out: dict[str, list[str]] = {
        "no estimate": [],
        "no ground truth": [],
        "pixels without an estimate": [],
    }
    for scene in SCENES:
        candidates = (estimates / f"{scene}.pfm", estimates / scene)
        estimate = next((path for path in candidates if path.exists()), None)
        place = find_scene(truth, scene)
        if estimate is None:
            left_out["no estimate"].append(scene)
        elif place is None or not (place / GROUND_TRUTH).is_file():
            left_out["no ground truth"].append(scene)
        else:
            metrics = evaluate_files(estimate, place / GROUND_TRUTH)
            bad = {f"badpix_{threshold:g}": value for threshold, value in metrics.badpix.items()}
            scores[scene] = bad | {"mse_x100": metrics.mse_x100, "q25_x100": metrics.q25_x100}
            if metrics.missing:
                left_out["pixels without an estimate"].append(f"{scene} ({metrics.missing})")
    if not scores:
        raise InputError(
            f"{estimates}: has no <scene>.pfm or folder <scene> of a scene whose {GROUND_TRUTH} is "
            f"in {truth}; the scenes are {', '.join(SCENES)}"
        )
    remarks = [f"{what}: {', '.join(names)}" for what, names in left_out.items() if names]
    return scores, "; ".join(remarks)


def tables(measured: Mapping[str, Scores]) -> list[Table]:
    """Return one table for each measure, with the published methods before the measured ones.

    Args:
        measured: Scores by method; scenes may be missing.
    """
    scores: dict[str, Scores] = {**published_scores(), **measured}
    common = [scene for scene in SCENES if all(scene in own for own in measured.values())]
    columns: tuple[str, ...] = (*SCENES, "average")
    if 0 < len(common) < len(SCENES):
        columns = (*columns, f"average of {len(common)}")
    result = []
    for measure, title in TITLES.items():
        rows, printed = {}, {}
        for method, own in scores.items():
            if measure not in next(iter(own.values())):
                continue
            means = [_mean(own, scenes, measure) for scenes in (SCENES, common)]
            rows[method] = [own[s][measure] if s in own else None for s in SCENES] + means
            rows[method] = rows[method][: len(columns)]
            if method not in measured:
                mean, paper = means[0], own[PRINTED_AVERAGE][measure]
                if mean is not None and abs(mean - paper) > _explained(rows[method], paper):
                    printed[method, "average"] = paper
        if rows:
            result.append(Table(title, columns, rows, printed))
    return result


def _mean(scores: Scores, scenes: Sequence[str], measure: str) -> float | None:
    """Return the mean over scenes; None if one is missing."""
    if not scenes or any(scene not in scores for scene in scenes):
        return None
    return sum(scores[scene][measure] for scene in scenes) / len(scenes)


def _explained(scores: Sequence[float | None], mean: float) -> float:
    """Return the difference that the rounding of scores and of their mean explains."""
    numbers = [score for score in scores[: len(SCENES)] if score is not None]
    return sum(map(rounding_error, numbers)) / len(numbers) + rounding_error(mean)


def _measure_all(
    methods: tuple[str, ...], truth: Path | None
) -> tuple[dict[str, Scores], list[str]]:
    """Score all methods; return scores by method, and a note on each incomplete method."""
    measured: dict[str, Scores] = {}
    notes = []
    for method in methods:
        name, separator, folder = method.partition("=")
        if not (name and separator and folder):
            raise InputError(f"{method!r}: is not NAME=FOLDER")
        if name in measured or name in published_scores():
            raise InputError(f"{name}: is the name of two methods; choose another name")
        if truth is None:
            raise InputError("methods need ground truth; pass --truth HCI")
        measured[name], remark = measure(Path(folder), truth)
        notes += [f"{name}: {remark}."] * bool(remark)
    return measured, notes


def _known() -> tuple[dict[str, Scores], list[str]]:
    """Score maps with known scores: MSE x100 0.04, BadPix 0, 0 and 100 %, Q25 x100 2."""
    true = sample().ground_truth
    assert true is not None
    with tempfile.TemporaryDirectory() as folder:
        for scene in SCENES:
            write_pfm(Path(folder) / "hci" / scene / GROUND_TRUTH, true)
            write_pfm(Path(folder) / "maps" / f"{scene}.pfm", true + np.float32(0.02))
        scores, _ = measure(Path(folder) / "maps", Path(folder) / "hci")
    return {"moved by 0.02": scores}, ["moved by 0.02: the bundled sample replaces every scene."]


if __name__ == "__main__":
    main(run, __doc__)
