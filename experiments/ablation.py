"""The ablation of table 3, row by row, with rows that the paper does not have.

    python -m experiments.ablation runs/table3 --data HCI/additional --validate HCI/training/*
    python -m experiments.ablation runs/table3 --recipe full         (procedural light fields)
    python -m experiments.ablation runs/table3 --show                (finished rows, no training)
    python -m experiments.ablation FOLDER --small                    (a smoke test, minutes)
    python -m experiments.ablation --reduced                         (committed tables, seconds)
    python -m experiments.ablation FOLDER --reduced --validate SCENE...         (hours on a CPU)

Cost: a row of the ``published`` recipe takes 480,000 steps of 32 patches, a week on an RTX 3090
according to the paper; ``full`` takes 20,000 steps on procedural light fields. Both need a GPU, and
``published`` needs the scenes of the HCI benchmark. Neither has been run at full size yet.
``--steps`` shortens a recipe. Finished rows are kept, and an interrupted row resumes; several
machines can share the folder and train different ``--rows``.

Expected, according to the paper: each ingredient improves the scores a little, and more candidates
in the first stage improve them most. The two rows of the same network, ``cas_2`` and
``cas_2_again``, differ by 0.14 in BadPix 0.07, more than many ingredients gain, so this script
trains that network twice too.

Rows that the paper does not have: ``cas_2_occ`` with the transposed warp of the published code, and
``cas_2`` on the mean and variance of the features over the views, which the paper proposes as
future work. Such a volume has no channels of single views for the attention, so ``cas_2`` without
attention is the row to compare it with. With ``--small`` the table still has the parameters and
FLOPs of the full networks.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import tyro

from experiments.command_line import main
from experiments.efficiency_table import mega, tera
from experiments.flops import count_flops, count_parameters
from experiments.markdown import markdown_table
from experiments.networks import CAS_2_AGAIN, TABLE_3, candidate_intervals, candidate_numbers
from experiments.reduced import INTERVAL_STUDY, QUESTIONS
from experiments.reduced_report import Reduced, run_reduced
from experiments.training_rows import Row, Scores, Training, select_rows
from occjax.cli.options import option
from occjax.errors import InputError
from occjax.models import preset

ROWS: Mapping[str, Row] = MappingProxyType(
    {
        **{name: Row(preset(name), published) for name, published in TABLE_3.items()},
        "cas_2_again": Row(preset("cas_2"), CAS_2_AGAIN, seed=1),
        "cas_2_occ_transposed": Row(preset("cas_2_occ", warp="transposed")),
        "cas_2_no_attention": Row(preset("cas_2").with_stages(attention=False)),
        "cas_2_statistics": Row(preset("cas_2").with_stages(attention=False, volume="statistics")),
    }
)
"""All trainings, by name."""

GROUPS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "stages": ("cas_1", "cas_2", "cas_3", "cas_4"),
        "sharing, occlusion": ("cas_2", "cas_2_share", "cas_2_occ", "cas_2_occ_gt"),
        "second interval": (
            *("cas_2_interval_1_2", "cas_2_interval_1_4", "cas_2", "cas_2_interval_1_16"),
        ),
        "first stage": ("cas_2_again", "cas_2_coarse_17", "cas_2_coarse_33", "occcasnet"),
        "warp": ("cas_2_occ", "cas_2_occ_transposed"),
        "volume": ("cas_2", "cas_2_no_attention", "cas_2_statistics"),
    }
)
"""Rows to compare with each other, as in table 3."""


def table(results: Mapping[str, Scores]) -> str:
    """Return the scores next to those of the paper, as Markdown, in the paper's groups.

    Args:
        results: Scores by row; other rows stay blank.
    """
    head = ["about", "row", "candidates", "intervals", "parameters", "FLOPs"]
    head += ["BadPix 0.07", "paper's table 3", "MSE x100", "paper's table 3"]
    lines = []
    for group, names in GROUPS.items():
        for name in names:
            row = ROWS[name]
            scores, paper = results.get(name, {}), row.published
            lines.append(
                [
                    *(group, f"`{name}`"),
                    *(candidate_numbers(row.network), candidate_intervals(row.network)),
                    mega(count_parameters(row.network)),
                    tera(count_flops(row.network)),
                    *(_number(scores.get("badpix_0.07")), _number(paper and paper.badpix)),
                    *(_number(scores.get("mse_x100")), _number(paper and paper.mse)),
                ]
            )
    return markdown_table(head, lines)


def run(
    folder: Annotated[
        tyro.conf.Positional[Path | None],
        tyro.conf.arg(metavar="FOLDER", help="Folder of all trainings."),
    ] = None,
    rows: Annotated[tuple[str, ...], option("Rows to train; by default all.", "ROW...")] = (),
    training: tyro.conf.OmitArgPrefixes[Training] = Training(),
    reduced: Reduced = False,
) -> dict[str, Scores]:
    """Train the rows, print the table and return the scores by row."""
    if reduced:
        questions = [name for name in QUESTIONS if name != INTERVAL_STUDY]
        print(run_reduced(folder, questions, training, "ablation", rows))
        return {}
    if folder is None:
        raise InputError("name the folder of the trainings, or pass --reduced")
    results = training.scores(training.sized(select_rows(rows, ROWS)), folder)
    print(table(results))
    return results


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


if __name__ == "__main__":
    main(run, __doc__)
