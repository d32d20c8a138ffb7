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
    queue,
    read_entries,
    train_and_score,
)
from experiments.training_rows import Training, select_rows
from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.viz.canvas import save

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
        halfway: Mean BadPix 0.07 of the training batches of the first seed before half of the
            steps, and at the end.
    """

    name: str
    multiply_adds: int
    seconds: float | None
    seeds: tuple[Mapping[tuple[str, str, str], float], ...]
    weights: tuple[tuple[float, float], ...]
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


HEAD = (
    *(
        "row",
        "seeds",
        "multiply-adds per step",
        "CPU s per megapixel",
        "MSE x100",
        "BadPix 0.07",
        "BadPix 0.03",
    ),
    *("BadPix 0.01", "Q25 x100", "BadPix 0.07 at edges", "BadPix 0.07 elsewhere"),
    *(
        "against the first row: all, edges, elsewhere",
        "paper's BadPix 0.07",
        "paper against its first row",
        "agrees",
    ),
)


def question_table(results: Mapping[str, Result], question: str, group: str) -> str | None:
    """Return the finished rows of a question on one set, as Markdown.

    Args:
        results: Results by row.
        question: Name in :data:`QUESTIONS`.
        group: Name in :data:`SETS`.

    Returns:
        The table; None if fewer than two rows have scores on the set.
    """
    main = ("all", "badpix_0.07")
    names = _finished(results, question)
    rows = [results[name] for name in names if results[name].values(group, *main)]
    if len(rows) < 2:
        return None
    first = QUESTIONS[question][0]
    lines = []
    for row in rows:
        cells = [f"`{row.name}`", str(len(row.values(group, *main)))]
        cells.append(f"{row.multiply_adds / 1e9:.2f} G")
        cells.append("" if row.seconds is None else f"{row.seconds:.1f}")
        cells += [_with_spread(row.values(group, "all", measure)) for measure in MEASURES]
        cells += [_with_spread(row.values(group, part, main[1])) for part in REGIONS[1:]]
        found, paper = [], ""
        if row.name != first and first in results:
            for part in REGIONS:
                own, base = (each.values(group, part, main[1]) for each in (row, results[first]))
                if own and base:
                    spread = spread_of_seeds(results, group, part, main[1])
                    found.append(compare_rows(mean(own) - mean(base), spread))
            if row.name in TABLE_3 and first in TABLE_3:
                difference = _published(row.name) - _published(first)
                paper = "lower" if difference < 0.0 else "higher"
        published = f"{_published(row.name):.3f}" if row.name in TABLE_3 else ""
        agrees = ""
        if found and paper:
            known = found[0] in ("lower", "higher")
            agrees = ("yes" if found[0] == paper else "no") if known else found[0]
        lines.append([*cells, ", ".join(found), published, paper, agrees])
    return markdown_table(HEAD, lines, right=True)


def report(results: Mapping[str, Result], questions: Sequence[str]) -> str:
    """Return all tables as Markdown, one for each question and set."""
    parts = []
    for question in questions:
        for group in SETS:
            table = question_table(results, question, group)
            if table is not None:
                parts.append(f"### {question.capitalize()}: {group}\n\n{table}")
    parts += [weights_text(results)] if parts else []
    parts.append(order_stability(results) if parts else "No two rows of a question are finished.")
    return "\n\n".join(part for part in parts if part)


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
