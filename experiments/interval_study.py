"""Accuracy, FLOPs and time of a single-stage network by the interval of its candidates.

    python -m experiments.interval_study FOLDER --data HCI/additional --validate HCI/training/*
    python -m experiments.interval_study FOLDER --recipe full        (procedural light fields)
    python -m experiments.interval_study FOLDER --weights FILE... --validate SCENE...
    python -m experiments.interval_study FOLDER --show --time        (what is done, no training)
    python -m experiments.interval_study FOLDER --small              (minutes, for the test)

The paper's figure 1: the network of LFattNet, candidates from -4 to 4. Which intervals the figure
has, its text does not say; here they are those that the paper names elsewhere, 1 to 1/8 in halves
and the 1/10 of SubFocal. Writes ``intervals.png`` into the folder and prints the table.

Cost: each interval is trained as a row of ``experiments.ablation`` is; the finest needs nine times
the operations of the coarsest. Nobody has run it at full size: it needs a GPU. ``--time`` wants one
too, at 256 pixels. Expected: the finer, the more accurate, at a cost that is proportional to the
number of candidates.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Annotated

import tyro
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter
from tqdm import tqdm

from experiments.command_line import main
from experiments.efficiency_table import tera
from experiments.markdown import markdown_table
from experiments.measuring import Measured, measure
from experiments.paper_training import Row, Training
from experiments.score_tables import shown
from experiments.training_rows import Scores, slug
from occjax.cli.options import option
from occjax.errors import InputError
from occjax.evaluation import BORDER
from occjax.models import NetworkConfig, load_weights, preset, sampled
from occjax.models.work import count_flops
from occjax.training import TrainConfig, scenes_from_folders
from occjax.training import validate as scores_on
from occjax.training.validation import check_scenes
from occjax.viz.canvas import save

INTERVALS = (1.0, 1 / 2, 1 / 4, 1 / 8, 1 / 10)
FIGURE = "intervals.png"

COLOUR = "#2a6fbb"
PANELS = ("BadPix 0.07 [%]", "MSE x100", "FLOPs", "time [s]")


@dataclass(frozen=True)
class Point:
    """One interval.

    Attributes:
        network: The network.
        flops: Operations of one estimate, counted as in the paper.
        scores: Accuracy, empty if it is not known.
        measured: Time and memory, if they were measured.
    """

    network: NetworkConfig
    flops: int
    scores: Scores
    measured: Measured | None = None

    @property
    def candidates(self) -> int:
        """Number of candidates."""
        return len(self.network.stages[0].candidates)

    @property
    def interval(self) -> float:
        """Distance of neighbouring candidates, pixels per view step."""
        first, second = self.network.stages[0].candidates[:2]
        return second - first

    @property
    def values(self) -> tuple[float | None, float | None, int, float | None]:
        """One value for each of :data:`PANELS`; None where it is not known."""
        bad, mse = self.scores.get("badpix_0.07"), self.scores.get("mse_x100")
        return bad, mse, self.flops, self.measured and self.measured.seconds


def with_interval(interval: float) -> NetworkConfig:
    """LFattNet with candidates of this interval.

    Args:
        interval: Distance of neighbouring candidates; must divide [-4, 4].

    Returns:
        The configuration.

    Raises:
        InputError: If it does not.

    Example:
        >>> len(with_interval(0.5).stages[0].candidates)
        17
    """
    network = preset("lfattnet")
    try:
        candidates = sampled(-4.0, 4.0, interval)
    except ValueError as error:
        raise InputError(f"--intervals: {error}") from error
    return dataclasses.replace(
        network, stages=(dataclasses.replace(network.stages[0], candidates=candidates),)
    )


def score_weights(
    files: Sequence[Path], folders: Sequence[Path], border: int
) -> tuple[dict[str, NetworkConfig], dict[str, Scores]]:
    """Accuracy of given weights.

    Args:
        files: Of single-stage networks.
        folders: Scenes with ground truth.
        border: Pixels left out at each side.

    Returns:
        Networks and scores, both by file.

    Raises:
        InputError: If there are no scenes, or a file holds a network of several stages or cannot be
            read.
    """
    if not folders:
        raise InputError("--weights needs scenes to score on: pass --validate SCENE...")
    networks: dict[str, NetworkConfig] = {}
    scores: dict[str, Scores] = {}
    for file in files:
        variables, network = load_weights(file)
        if network.views is None or len(network.stages) > 1:
            raise InputError(f"{file}: holds no network of a single stage")
        config = TrainConfig(network)
        scenes = scenes_from_folders(folders, config)
        check_scenes(scenes, border=border)
        networks[str(file)] = network
        scores[str(file)] = scores_on(variables, scenes, config, border=border)
    return networks, scores


def table(points: Sequence[Point]) -> str:
    """All that is known of each interval, as Markdown.

    Args:
        points: The intervals.

    Returns:
        The table, with a line feed between its lines.
    """
    head = ["interval", "candidates", *PANELS, "peak memory"]
    rows = []
    for point in points:
        bad, mse, flops, seconds = point.values
        rows.append(
            [
                _fraction(point.interval),
                str(point.candidates),
                *("" if score is None else shown(score) for score in (bad, mse)),
                tera(flops),
                "" if seconds is None else f"{seconds:.3g}",
                f"{point.measured.memory / 1e9:.2f} GB" if point.measured else "",
            ]
        )
    return markdown_table(head, rows)


def figure(points: Sequence[Point]) -> Figure:
    """A panel for each measure over the number of candidates; none for what is not known.

    Args:
        points: The intervals.

    Returns:
        The figure.
    """
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


def run(
    folder: Annotated[
        tyro.conf.Positional[Path], tyro.conf.arg(metavar="FOLDER", help="Of all trainings.")
    ],
    training: tyro.conf.OmitArgPrefixes[Training] = Training(),
    weights: Annotated[tuple[Path, ...], option("Score these, train nothing.", "FILE...")] = (),
    intervals: Annotated[
        tuple[float, ...], tyro.conf.arg(help="Distances of neighbouring candidates.")
    ] = INTERVALS,
    time: Annotated[
        bool, tyro.conf.arg(help="Run every network, for its time and memory.")
    ] = False,
    repeats: Annotated[int, tyro.conf.arg(help="Timed runs of each, of which the median.")] = 10,
    size: Annotated[
        int, tyro.conf.arg(help="Height and width of the views for FLOPs and time, pixels.")
    ] = 256,
) -> list[Point]:
    """Train or read every interval, print the table, draw the figure and return the points."""
    if training.small:
        size, repeats = 32, 1
    rows = {f"interval_{slug(_fraction(each))}": Row(with_interval(each)) for each in intervals}
    rows = training.sized(rows)
    networks = {name: row.network for name, row in rows.items()}
    if weights:
        border = 4 if training.small else BORDER
        networks, scores = score_weights(weights, training.validate, border)
    measured = {}
    if time:  # before this process takes a GPU
        for name, network in tqdm(networks.items(), unit="network", disable=None):
            measured[name] = measure(network, size, repeats=repeats)
    if not weights:
        scores = training.scores(rows, folder)
    points = [
        Point(network, count_flops(network, (size, size)), scores.get(name, {}), measured.get(name))
        for name, network in networks.items()
    ]
    points.sort(key=lambda point: -point.interval)
    save(figure(points), folder / FIGURE)
    print(table(points))
    return points


def _fraction(value: float) -> str:
    return str(Fraction(value).limit_denominator(1000))


if __name__ == "__main__":
    main(run, __doc__)
