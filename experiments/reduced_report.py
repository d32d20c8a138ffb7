"""Tables and plots of the reduced study, from the logs of its trainings."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import mean, median, stdev
from typing import Annotated, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy import stats
from tyro.conf import arg

from experiments.markdown import markdown_table, write_text
from experiments.networks import TABLE_3
from experiments.reduced import (
    LOGS,
    MEASURES,
    NETWORKS,
    QUESTIONS,
    REGIONS,
    SETS,
    ReducedConfig,
    queue,
    read_entries,
    train_and_score,
)
from experiments.training_rows import Training, select_rows
from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.viz.canvas import save

MAIN = ("all", "badpix_0.07")
"""Region and measure by which rows are compared."""

Reduced = Annotated[bool, arg(help="Networks of a reduced size; without FOLDER, committed logs.")]
"""Type of the option ``--reduced``."""


def run_reduced(
    folder: Path | None,
    questions: Sequence[str],
    training: Training,
    stem: str,
    rows: Sequence[str] = (),
) -> str:
    """Train and score the rows of questions, and return their tables.

    Args:
        folder: Folder of the trainings; None uses the committed logs without any training.
        questions: Names in :data:`QUESTIONS`.
        training: Options of the command line, of which ``validate`` and ``show`` are used.
        stem: Name of the tables and plots in the folder, without suffix.
        rows: Rows to train; by default all.

    Returns:
        The tables as Markdown.

    Raises:
        InputError: If there is no row of a name, or see :func:`train_and_score`.
    """
    select_rows(rows, NETWORKS)
    if folder is None:
        return report(read_results(LOGS), questions)
    if not training.show:
        todo = [each for each in queue(questions) if not rows or each[0] in rows]
        train_and_score(folder, todo, training.validate)
    return write_report(folder, questions, stem)


class Result(NamedTuple):
    """Result of a row: its scores by seed.

    Attributes:
        name: Name of the row.
        multiply_adds: Multiply-adds of a training step.
        seconds: CPU seconds of an estimate per megapixel; None if unknown.
        seeds: For each seed, scores by set, region and measure.
        weights: For each seed, the fraction of hidden views and their share of the weight, see
            :func:`weight_on_hidden_views`.
        hours: For each seed, hours of the training.
        halfway: Mean BadPix 0.07 of the training batches of the first seed before half of the
            steps, and at the end.
    """

    name: str
    multiply_adds: int
    seconds: float | None
    seeds: tuple[Mapping[tuple[str, str, str], float], ...]
    weights: tuple[tuple[float, float], ...]
    hours: tuple[float, ...]
    halfway: tuple[float, float] | None

    def values(self, group: str, region: str, measure: str) -> list[float]:
        """Return a score of each seed that has it."""
        key = (group, region, measure)
        return [scores[key] for scores in self.seeds if key in scores]


def read_results(folder: Path) -> dict[str, Result]:
    """Read the logs of all finished rows of a folder, by name.

    Args:
        folder: Folder with files ``ROW-SEED.jsonl``.

    Raises:
        InputError: If rows were trained with different settings.
    """
    found: dict[str, Result] = {}
    configs = []
    for name in NETWORKS:
        logs = [read_entries(path) for path in sorted(folder.glob(f"{name}-[0-9].jsonl"))]
        logs = [log for log in logs if any(entry["kind"] == "scores" for entry in log)]
        if logs:
            configs += [log[0]["config"] for log in logs]
            times = [
                line["seconds_per_megapixel"]
                for log in logs
                for line in log
                if line["kind"] == "time"
            ]
            found[name] = Result(
                name,
                logs[0][0]["multiply_adds"],
                median(times) if times else None,
                tuple(_by_set(log) for log in logs),
                tuple(
                    (line["hidden_views"], line["weight_on_hidden"])
                    for log in logs
                    for line in log
                    if line["kind"] == "weights"
                ),
                tuple(_hours(log) for log in logs),
                _halfway(logs[0]),
            )
    if any(config != configs[0] for config in configs):
        raise InputError(f"{folder}: rows were trained with different settings; train them again")
    return found


def _by_set(log: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str, str], float]:
    """Return the mean of each score over the scenes of a set, for the sets that are complete."""
    lines = {(line["scene"], line["region"]): line for line in log if line["kind"] == "scores"}
    scores = {}
    for group, scenes in SETS.items():
        for region in REGIONS:
            if all((scene, region) in lines for scene in scenes):
                for measure in MEASURES:
                    values = [lines[scene, region][measure] for scene in scenes]
                    scores[group, region, measure] = mean(values)
    return scores


def _hours(log: Sequence[Mapping[str, Any]]) -> float:
    """Return the duration of the steps of a training, in hours."""
    lines = [line for line in log if line["kind"] == "train"]
    begins = [0, *(line["step"] for line in lines)]
    seconds = [
        line["seconds_per_step"] * (line["step"] - begin)
        for line, begin in zip(lines, begins, strict=False)
    ]
    return sum(seconds) / 3600


def _halfway(log: Sequence[Mapping[str, Any]]) -> tuple[float, float] | None:
    """Return the mean BadPix 0.07 of training in the last fifth of the first half, and of all."""
    lines = [line for line in log if line["kind"] == "train"]
    if not lines:
        return None
    steps = lines[-1]["step"]

    def until(last):
        return mean(x["badpix"] for x in lines if last - 0.2 * steps < x["step"] <= last)

    return until(0.5 * steps), until(steps)


def order_stability(results: Mapping[str, Result]) -> str:
    """Say how similar the order of the rows is at half of the steps and at the end.

    All rows train on the same batches, so that their errors on these can be compared.
    """
    pairs = [row.halfway for row in results.values() if row.halfway is not None]
    if len(pairs) < 3:
        return ""
    half, full = np.transpose(pairs)
    rank = stats.spearmanr(half, full).statistic
    return (
        "Between half of the steps and the end, the mean BadPix 0.07 of the training batches "
        f"falls from {half.mean():.1f} to {full.mean():.1f}; the rank correlation of the "
        f"{len(pairs)} rows is {rank:.2f}."
    )


def spread_of_seeds(
    results: Mapping[str, Result], group: str, region: str, measure: str
) -> float | None:
    """Return the standard deviation over seeds, pooled over the rows with several seeds.

    Returns:
        Root of the mean variance; None if no row has several seeds.
    """
    several = [row.values(group, region, measure) for row in results.values()]
    variances = [stdev(values) ** 2 for values in several if len(values) > 1]
    return mean(variances) ** 0.5 if variances else None


def compare_rows(difference: float, spread: float | None) -> str:
    """Return whether an error is ``"lower"`` or ``"higher"``, or ``"none"`` within the spread.

    Example:
        >>> compare_rows(-0.3, 0.2), compare_rows(0.1, 0.2), compare_rows(0.1, None)
        ('lower', 'none', 'not known')
    """
    if spread is None:
        return "not known"
    if abs(difference) <= spread:
        return "none"
    return "lower" if difference < 0.0 else "higher"


LEGEND = f"""\
A row is a network of `experiments.networks` or `experiments.reduced`, at the reduced size.
Scores are means over its seeds ± their standard deviation. A row is `lower` or `higher` than the
first row of its question if the mean difference over their common seeds is larger than the
spread of seeds: the standard deviation over the seeds, pooled over all rows that have several.
Otherwise the difference is `none`. A row agrees with the paper if its difference has the
direction of the paper's table 3. Edges are the pixels within {ReducedConfig().edge_band:g} \
pixels of a depth edge.
Multiply-adds are those of the layers in a training step."""
"""What stands above the tables."""

SCORES_HEAD = (
    *("row", "set", "MSE x100", "BadPix 0.07", "BadPix 0.03", "BadPix 0.01", "Q25 x100"),
    *("BadPix 0.07 at edges", "BadPix 0.07 elsewhere"),
    "BadPix 0.07 against the same seeds of the first row: all, at edges, elsewhere",
)


def rows_table(results: Mapping[str, Result], question: str) -> str:
    """Return the cost of the finished rows of a question next to the paper, as Markdown.

    :data:`LEGEND` says when a row agrees with the paper.

    Args:
        results: Results by row.
        question: Name in :data:`QUESTIONS`.
    """
    head = ["row", "seeds", "multiply-adds per step", "CPU s per megapixel"]
    head += ["paper's BadPix 0.07", f"agrees with the paper on {', '.join(SETS)}"]
    first = QUESTIONS[question][0]
    lines = []
    for name in _finished(results, question):
        row = results[name]
        agrees = []
        if {name, first} <= set(TABLE_3) and name != first and first in results:
            paper = "lower" if _published(name) < _published(first) else "higher"
            for group in SETS:
                found = _against(row, results[first], results, group, "all")
                known = found in ("lower", "higher")
                agrees.append(("yes" if found == paper else "no") if known else found)
        lines.append(
            [
                *(f"`{name}`", str(len(row.seeds)), f"{row.multiply_adds / 1e9:.2f} G"),
                "" if row.seconds is None else f"{row.seconds:.1f}",
                f"{_published(name):.3f}" if name in TABLE_3 else "",
                ", ".join(agrees),
            ]
        )
    return markdown_table(head, lines, right=True)


def scores_table(results: Mapping[str, Result], question: str) -> str:
    """Return the scores of the finished rows of a question on every set, as Markdown.

    Args:
        results: Results by row.
        question: Name in :data:`QUESTIONS`.
    """
    names, first = _finished(results, question), QUESTIONS[question][0]
    lines = []
    for group in SETS:
        for name in names:
            row = results[name]
            if not row.values(group, *MAIN):
                continue
            cells = [_with_spread(row.values(group, "all", measure)) for measure in MEASURES]
            cells += [_with_spread(row.values(group, part, MAIN[1])) for part in REGIONS[1:]]
            found = []
            if name != first and first in results:
                found = [_against(row, results[first], results, group, part) for part in REGIONS]
            lines.append([f"`{name}`", group, *cells, ", ".join(found)])
    return markdown_table(SCORES_HEAD, lines, right=True)


def _against(
    row: Result, first: Result, results: Mapping[str, Result], group: str, region: str
) -> str:
    """Compare the BadPix 0.07 of a row with that of another, see :func:`compare_rows`.

    The seeds that both rows have are compared: rows of one seed train on the same batches.
    """
    own, other = (each.values(group, region, MAIN[1]) for each in (row, first))
    differences = [one - base for one, base in zip(own, other, strict=False)]
    if not differences:
        return "not known"
    return compare_rows(mean(differences), spread_of_seeds(results, group, region, MAIN[1]))


def report(results: Mapping[str, Result], questions: Sequence[str]) -> str:
    """Return the tables of all questions with several finished rows, as Markdown."""
    rows = {name: results[name] for each in questions for name in _finished(results, each)}
    parts = [
        f"### {question.capitalize()}\n\n{rows_table(results, question)}\n\n"
        f"{scores_table(results, question)}"
        for question in questions
        if len(_finished(results, question)) > 1
    ]
    if not parts:
        return "No two rows of a question are finished."
    parts.insert(0, LEGEND)
    parts += [weights_text(rows), order_stability(rows), hours_text(rows)]
    return "\n\n".join(part for part in parts if part)


def hours_text(results: Mapping[str, Result]) -> str:
    """Say how long the trainings took."""
    hours = [each for row in results.values() for each in row.hours]
    return f"The {len(hours)} trainings took {sum(hours):.1f} hours."


def weights_text(results: Mapping[str, Result]) -> str:
    """Say how much of the weight of equation 6 hidden views have; nothing if no row measured it."""
    rows = [row for row in results.values() if row.weights]
    if not rows:
        return ""
    hidden = 100 * mean(one[0] for row in rows for one in row.weights)
    shares = (f"{100 * mean(one[1] for one in row.weights):.1f} % in `{row.name}`" for row in rows)
    return (
        "At the pixels near depth edges that not all views see, on the procedural light fields, "
        f"{hidden:.1f} % of the views are hidden. They have this share of the weights of equation "
        f"6: {', '.join(shares)}."
    )


def write_scores(results: Mapping[str, Result], path: Path) -> None:
    """Write every score of every row and seed to a CSV file."""
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["row", "seed", "multiply_adds", "set", "region", *MEASURES])
        for row in results.values():
            for seed, scores in enumerate(row.seeds):
                for group, region in dict.fromkeys((key[0], key[1]) for key in scores):
                    values = [scores[group, region, measure] for measure in MEASURES]
                    writer.writerow([row.name, seed, row.multiply_adds, group, region, *values])


def figure(results: Mapping[str, Result], questions: Sequence[str], group: str) -> Figure:
    """Plot BadPix 0.07 of each row by region, one panel for each question; a dot is a seed."""
    shown = [(question, _finished(results, question)) for question in questions]
    heights = [len(names) + 1 for _, names in shown]
    picture = Figure(figsize=(6.5, 0.3 * sum(heights) + 1), layout="constrained")
    picture.set_facecolor("white")
    panels = picture.subplots(
        len(shown), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
    )
    colours = dict(zip(REGIONS, ("#222222", "#c0504d", "#2a6fbb"), strict=True))
    for axes, (question, names) in zip(panels[:, 0], shown, strict=True):
        for place, name in enumerate(names):
            for region, colour in colours.items():
                values = results[name].values(group, region, "badpix_0.07")
                axes.plot(values, [place] * len(values), "o", ms=4, color=colour, alpha=0.7)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_title(question, loc="left", fontsize="medium")
        axes.grid(axis="x", alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    panels[-1, 0].set_xlabel(f"BadPix 0.07 [%] on the set {group}")
    handles = [
        panels[0, 0].plot([], [], "o", color=colour, label=region)[0]
        for region, colour in colours.items()
    ]
    picture.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return picture


def write_report(folder: Path, questions: Sequence[str], stem: str) -> str:
    """Read the logs of a folder, and write the tables and the plot into it.

    Args:
        folder: Folder with the logs.
        questions: Questions to report.
        stem: Name of the files without suffix.

    Returns:
        The tables as Markdown.
    """
    results = read_results(folder)
    text = report(results, questions)
    compared = [name for name in questions if len(_finished(results, name)) > 1]
    if compared:
        write_text(folder / f"{stem}.md", text)
        rows = {row for question in questions for row in QUESTIONS[question]}
        write_scores({n: r for n, r in results.items() if n in rows}, folder / f"{stem}.csv")
        save(figure(results, compared, "procedural"), folder / f"{stem}.png")
    return text


def _finished(results: Mapping[str, Result], question: str) -> list[str]:
    """Return the names of the finished rows of a question."""
    return [name for name in QUESTIONS[question] if name in results]


def _published(name: str) -> float:
    badpix = TABLE_3[name].badpix
    assert badpix is not None
    return badpix


def _with_spread(values: Sequence[float]) -> str:
    if not values:
        return ""
    shown = f"{mean(values):.2f}"
    return shown if len(values) == 1 else f"{shown} ± {stdev(values):.2f}"
