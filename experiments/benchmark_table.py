"""Scores on the twelve scenes of the HCI 4D benchmark, beside those that were published.

    python -m experiments.benchmark_table > experiments/benchmark_table.md
    python -m experiments.benchmark_table NAME=FOLDER... --truth HCI -o tables
    python -m experiments.benchmark_table --small                  (a check of the script itself)

FOLDER holds the estimates of a method: ``<scene>.pfm``, as in ``disp_maps`` of a submission, or the
result folders of ``occjax estimate``, ``<scene>``. HCI is a folder with the benchmark's scenes,
as its archives unpack. Scenes without an estimate or without ground truth, which the benchmark
keeps to itself for four, show a dash; then a further column has the average over those scenes that
all measured methods have, so that it can be compared. ``-o`` writes Markdown, LaTeX and a picture.

Cost: seconds. Expected: the paper's table 1, with the same marks but for one: second best by MSE on
backgammon is Epinet-fcn-m, not OccCasNet. Averages are computed from the twelve scores; where
rounding does not explain that the paper prints another one (of OccCasNet BadPix 0.07, of SPO 0.03,
of FastLFnet 0.01), that follows in brackets. The paper has no Q25 by scene, so its table is of
measured methods alone. The published methods' tables are committed as ``benchmark_table.md``;
nobody has measured all scenes with this library yet.

``--small`` measures maps whose scores are known: the bundled sample's ground truth moved by 0.02.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from tyro.conf import Positional, arg

from experiments.command_line import main
from experiments.hci_scenes import find_scene
from experiments.score_tables import Table, latex, markdown, picture, rounding
from occjax.cli.options import option
from occjax.data.sample import sample
from occjax.errors import InputError
from occjax.evaluation import evaluate_files
from occjax.evaluation.published import (
    SCENES,
    average,
    printed_average,
    published_methods,
    published_scores,
)
from occjax.io import atomic_path, write_pfm
from occjax.viz import save

TITLES = {
    "badpix_0.07": "BadPix 0.07",
    "badpix_0.03": "BadPix 0.03",
    "badpix_0.01": "BadPix 0.01",
    "mse_x100": "MSE x100",
    "q25_x100": "Q25 x100",
}
"""By measure, in the paper's order."""

TRUTH = "gt_disp_lowres.pfm"

Scores = Mapping[str, Mapping[str, float]]
"""By scene, by measure."""


def run(
    methods: Positional[
        Annotated[tuple[str, ...], option("Methods to measure.", "NAME=FOLDER")]
    ] = (),
    truth: Annotated[Path | None, option("Folder of the benchmark's scenes.", "HCI")] = None,
    output: Annotated[
        Path | None, option("Write benchmark_table.md, .tex and .png there.", "FOLDER", "-o")
    ] = None,
    small: Annotated[bool, arg(help="Measure maps whose scores are known.")] = False,
) -> int:
    """Print the tables."""
    if small:
        if methods or truth:
            raise InputError("--small makes its own maps; leave out methods and --truth")
        measured, notes = _known()
    else:
        measured, notes = _measure_all(methods, truth)
    all_tables = tables(measured)
    if any(table.printed for table in all_tables):
        notes.insert(
            0, "In brackets: what the paper prints, which is not the mean of its twelve scores."
        )
    print(markdown(all_tables, notes))
    if output is not None:
        for suffix, text in (
            (".md", markdown(all_tables, notes)),
            (".tex", latex(all_tables, notes)),
        ):
            with atomic_path(output / f"benchmark_table{suffix}") as temporary:
                temporary.write_text(text + "\n", encoding="utf-8")
        save(picture(all_tables, notes), output / "benchmark_table.png")
    return 0


def measure(estimates: Path, truth: Path) -> tuple[dict[str, dict[str, float]], str]:
    """Scores of one method on every scene that has an estimate and ground truth.

    Args:
        estimates: Folder with ``<scene>.pfm`` or result folders ``<scene>``.
        truth: Folder of the benchmark's scenes.

    Returns:
        By scene, by measure; and what is to be said about them, or an empty string.

    Raises:
        InputError: If there is nothing to measure, or a map cannot be used.
    """
    if not estimates.is_dir():
        raise InputError(f"{estimates}: there is no such folder; check the path")
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
        elif place is None or not (place / TRUTH).is_file():
            left_out["no ground truth"].append(scene)
        else:
            metrics = evaluate_files(estimate, place / TRUTH)
            bad = {f"badpix_{threshold:g}": value for threshold, value in metrics.badpix.items()}
            scores[scene] = bad | {"mse_x100": metrics.mse_x100, "q25_x100": metrics.q25_x100}
            if metrics.missing:
                left_out["pixels without an estimate"].append(f"{scene} ({metrics.missing})")
    if not scores:
        raise InputError(
            f"{estimates}: has no <scene>.pfm or folder <scene> of a scene whose {TRUTH} is in "
            f"{truth}; the scenes are {', '.join(SCENES)}"
        )
    remarks = [f"{what}: {', '.join(names)}" for what, names in left_out.items() if names]
    return scores, "; ".join(remarks)


def tables(measured: Mapping[str, Scores]) -> list[Table]:
    """One table a measure: published methods, then measured ones.

    Args:
        measured: Scores by method, of some scenes or all.
    """
    scores: dict[str, Scores] = {name: published_scores(name) for name in published_methods()}
    scores |= measured
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
                mean, paper = means[0], printed_average(method)[measure]
                if mean is not None and abs(mean - paper) > _explained(rows[method], paper):
                    printed[method, "average"] = paper
        if rows:
            result.append(Table(title, columns, rows, printed))
    return result


def _mean(scores: Scores, scenes: Sequence[str], measure: str) -> float | None:
    """Mean over scenes, if all of them are there."""
    if not scenes or any(scene not in scores for scene in scenes):
        return None
    return average({scene: scores[scene] for scene in scenes})[measure]


def _explained(scores: Sequence[float | None], mean: float) -> float:
    """Difference that the rounding of scores and their mean explains."""
    numbers = [score for score in scores[: len(SCENES)] if score is not None]
    return sum(map(rounding, numbers)) / len(numbers) + rounding(mean)


def _measure_all(
    methods: tuple[str, ...], truth: Path | None
) -> tuple[dict[str, Scores], list[str]]:
    """Scores by method, and a note on each that is not complete."""
    measured: dict[str, Scores] = {}
    notes = []
    for method in methods:
        name, separator, folder = method.partition("=")
        if not (name and separator and folder):
            raise InputError(f"{method!r} does not say which method is where; pass NAME=FOLDER")
        if name in measured or name in published_methods():
            raise InputError(f"there are two methods called {name}; choose another name")
        if truth is None:
            raise InputError("pass the folder of the benchmark's scenes with --truth")
        measured[name], remark = measure(Path(folder), truth)
        notes += [f"{name}: {remark}."] * bool(remark)
    return measured, notes


def _known() -> tuple[dict[str, Scores], list[str]]:
    """Scores of the small form: MSE x100 0.04, BadPix 0, 0 and 100 %, Q25 x100 2."""
    true = sample().ground_truth
    assert true is not None
    with tempfile.TemporaryDirectory() as folder:
        for scene in SCENES:
            write_pfm(Path(folder) / "hci" / scene / TRUTH, true)
            write_pfm(Path(folder) / "maps" / f"{scene}.pfm", true + np.float32(0.02))
        scores, _ = measure(Path(folder) / "maps", Path(folder) / "hci")
    return {"moved by 0.02": scores}, ["moved by 0.02: the bundled sample in place of every scene."]


if __name__ == "__main__":
    main(run, __doc__)
