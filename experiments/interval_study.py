"""Accuracy, FLOPs and time of a single-stage network by the interval of its candidates (figure 1).

    python -m experiments.interval_study FOLDER --data HCI/additional --validate HCI/training/*
    python -m experiments.interval_study FOLDER --recipe full        (procedural light fields)
    python -m experiments.interval_study FOLDER --show --time        (finished rows, no training)
    python -m experiments.interval_study FOLDER --small              (a smoke test, minutes)
    python -m experiments.interval_study --reduced                   (committed table, seconds)
    python -m experiments.interval_study FOLDER --reduced --validate SCENE...   (hours on a CPU)

Cost: each interval is trained as a row of ``experiments.ablation``; the finest needs nine times the
operations of the coarsest. It needs a GPU, and so does ``--time`` at 256 pixels. It has not been
run at full size yet. Expected: smaller intervals give smaller errors at a cost that is proportional
to the number of candidates. The script prints a table and writes ``intervals.png``.

The network is that of LFattNet with candidates from -4 to 4. The paper's text does not list the
intervals of its figure; these are the ones that it names elsewhere, 1 to 1/8 in halves and the 1/10
of SubFocal.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from statistics import mean
from typing import Annotated

import tyro
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter
from tqdm import tqdm

from experiments.command_line import main
from experiments.efficiency_table import tera
from experiments.flops import count_flops
from experiments.markdown import markdown_table
from experiments.measuring import Measurement, measure
from experiments.reduced import (
    INTERVAL_STUDY,
    LOGS,
    NETWORKS,
    QUESTIONS,
    ReducedConfig,
    reduced_form,
)
from experiments.reduced_report import Reduced, read_results, run_reduced
from experiments.score_tables import format_score
from experiments.training_rows import Row, Scores, Training, slug
from occjax.errors import InputError
from occjax.models import OccCasNetConfig, evenly_spaced, preset
from occjax.viz.canvas import save

INTERVALS = (1.0, 1 / 2, 1 / 4, 1 / 8, 1 / 10)
FIGURE = "intervals.png"
COLOUR = "#2a6fbb"
PANELS = ("BadPix 0.07 [%]", "MSE x100", "FLOPs", "time [s]")


@dataclass(frozen=True)
class Point:
    """Result of one interval.

    Attributes:
        network: The network.
        flops: Operations of one estimate, counted as in the paper.
        scores: Accuracy; empty if the network has not been trained.
        measured: Time and memory; None if they were not measured.
    """

    network: OccCasNetConfig
    flops: int
    scores: Scores
    measured: Measurement | None = None

    @property
    def candidates(self) -> int:
        """Number of candidates."""
        return len(self.network.stages[0].candidates)

    @property
    def interval(self) -> float:
        """Interval between candidates, pixels per view step."""
        first, second = self.network.stages[0].candidates[:2]
        return second - first

    @property
    def values(self) -> tuple[float | None, float | None, int, float | None]:
        """Values of :data:`PANELS`; None where a value is unknown."""
        bad, mse = self.scores.get("badpix_0.07"), self.scores.get("mse_x100")
        return bad, mse, self.flops, self.measured and self.measured.seconds


def with_interval(interval: float) -> OccCasNetConfig:
    """Return LFattNet with an interval between its candidates.

    Args:
        interval: Interval in pixels per view step; it must divide [-4, 4].

    Returns:
        The configuration.

    Raises:
        InputError: If the interval does not divide the range.

    Example:
        >>> len(with_interval(0.5).stages[0].candidates)
        17
    """
    network = preset("lfattnet")
    try:
        candidates = evenly_spaced(-4.0, 4.0, interval)
    except ValueError as error:
        raise InputError(f"--intervals: {error}") from error
    return dataclasses.replace(
        network, stages=(dataclasses.replace(network.stages[0], candidates=candidates),)
    )


def table(points: Sequence[Point]) -> str:
    """Return the results as a Markdown table; unknown values stay blank."""
    head = ["interval", "candidates", *PANELS, "peak memory"]
    rows = []
    for point in points:
        bad, mse, flops, seconds = point.values
        rows.append(
            [
                _fraction(point.interval),
                str(point.candidates),
                *("" if score is None else format_score(score) for score in (bad, mse)),
                tera(flops),
                "" if seconds is None else f"{seconds:.3g}",
                f"{point.measured.memory / 1e9:.2f} GB" if point.measured else "",
            ]
        )
    return markdown_table(head, rows)


def figure(points: Sequence[Point]) -> Figure:
    """Plot each measure against the number of candidates; unknown measures have no panel."""
    known = [
        (number, name)
        for number, name in enumerate(PANELS)
        if any(point.values[number] is not None for point in points)
    ]
    picture = Figure(figsize=(3.5 * len(known), 3.0), layout="constrained", facecolor="white")
    panels = picture.subplots(1, len(known), squeeze=False)[0]
    for axes, (number, name) in zip(panels, known, strict=True):
        at = [point for point in points if point.values[number] is not None]
        axes.plot([p.candidates for p in at], [p.values[number] for p in at], "o-", color=COLOUR)
        axes.set_xticks(
            [point.candidates for point in points],
            [f"{point.candidates}\n{_fraction(point.interval)}" for point in points],
        )
        axes.set(title=name, xlabel="candidates, interval [pixels per view step]")
        axes.set_ylim(0.0, 1.1 * max(point.values[number] for point in at) or 1.0)
        if name == "FLOPs":
            axes.yaxis.set_major_formatter(EngFormatter())
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    return picture


def reduced_points(folder: Path) -> list[Point]:
    """Return the finished rows of the reduced study, with FLOPs and CPU time per megapixel."""
    results = read_results(folder)
    points = []
    for name in QUESTIONS[INTERVAL_STUDY]:
        if name in results:
            row, network = results[name], reduced_form(NETWORKS[name], ReducedConfig())
            scores = {
                measure: mean(row.values("procedural", "all", measure))
                for measure in ("badpix_0.07", "mse_x100")
            }
            measured = None if row.seconds is None else Measurement(row.seconds, 0)
            points.append(Point(network, count_flops(network, (1000, 1000)), scores, measured))
    return points


def run(
    folder: Annotated[
        tyro.conf.Positional[Path | None],
        tyro.conf.arg(metavar="FOLDER", help="Folder of all trainings."),
    ] = None,
    training: tyro.conf.OmitArgPrefixes[Training] = Training(),
    intervals: Annotated[
        tuple[float, ...], tyro.conf.arg(help="Intervals, in pixels per view step.")
    ] = INTERVALS,
    time: Annotated[bool, tyro.conf.arg(help="Measure time and memory too.")] = False,
    size: Annotated[
        int, tyro.conf.arg(help="Height and width of the views for FLOPs and time, in pixels.")
    ] = 256,
    reduced: Reduced = False,
) -> list[Point]:
    """Train or read every interval, print the table, draw the figure and return the points."""
    if reduced:
        print(run_reduced(folder, [INTERVAL_STUDY], training, "interval_study"))
        points = reduced_points(folder or LOGS)
        if folder is not None and points:
            save(figure(points), folder / "interval_study_cost.png")
        return points
    if folder is None:
        raise InputError("name the folder of the trainings, or pass --reduced")
    repeats = 10
    if training.small:
        size, repeats = 32, 1
    rows = {f"interval_{slug(_fraction(each))}": Row(with_interval(each)) for each in intervals}
    rows = training.sized(rows)
    measured = {}
    if time:  # before this process reserves the memory of a GPU
        for name, row in tqdm(rows.items(), unit="network", disable=None):
            measured[name] = measure(row.network, size, repeats=repeats)
    scores = training.scores(rows, folder)
    points = [
        Point(
            row.network,
            count_flops(row.network, (size, size)),
            scores.get(name, {}),
            measured.get(name),
        )
        for name, row in rows.items()
    ]
    points.sort(key=lambda point: -point.interval)
    save(figure(points), folder / FIGURE)
    print(table(points))
    return points


def _fraction(value: float) -> str:
    return str(Fraction(value).limit_denominator(1000))


if __name__ == "__main__":
    main(run, __doc__)
