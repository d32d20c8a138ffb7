"""The ablation of table 3, row by row, and what the paper does not have.

    python -m experiments.ablation runs/table3 --data HCI/additional --validate HCI/training/*
    python -m experiments.ablation runs/table3 --recipe full         (procedural light fields)
    python -m experiments.ablation runs/table3 --show                (what is done, no training)
    python -m experiments.ablation FOLDER --small                    (minutes, for the test)

Cost: a row of the ``published`` recipe is 480,000 steps of 32 patches, which its authors say took a
week on an RTX 3090; ``full`` is 20,000 steps on procedural light fields. ``--steps`` shortens
either, its learning rate's schedule in proportion. Nobody has run either at full size: it needs a
GPU, and ``published`` the scenes of the HCI benchmark. Rows that are done are kept, one that was
interrupted goes on; machines that share the folder can each take some ``--rows``.

Expected, by the paper: each ingredient helps a little and more candidates in the first stage help
most. Its two rows of one network, ``cas_2`` and ``cas_2_again``, are 0.14 apart in BadPix 0.07,
more than many of its ingredients gain, so that row is trained twice here too.

Not in the paper: ``cas_2_occ`` with the warp of the published code, which moves rows with u; and
``cas_2`` on the mean and variance of the features over the views, which the paper names as future
work. Such a volume has no channels of single views to attend to, so ``cas_2`` without attention
stands beside it. Parameters and FLOPs, by formula, are those of the full networks, also with
``--small``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

import tyro

from experiments.command_line import main
from experiments.efficiency_table import mega, tera
from experiments.markdown import markdown_table
from experiments.networks import CAS_2_AGAIN, TABLE_3, candidate_intervals, candidate_numbers
from experiments.paper_training import Row, Training
from experiments.training_rows import Scores, chosen
from occjax.cli.options import option
from occjax.models import preset
from occjax.models.work import count_flops, count_parameters

ROWS: Mapping[str, Row] = MappingProxyType(
    {
        **{name: Row(preset(name), published) for name, published in TABLE_3.items()},
        "cas_2_again": Row(preset("cas_2"), CAS_2_AGAIN, seed=1),
        "cas_2_occ_transposed": Row(preset("cas_2_occ", warp="transposed")),
        "cas_2_no_attention": Row(preset("cas_2").with_stages(attention=False)),
        "cas_2_statistics": Row(preset("cas_2").with_stages(attention=False, volume="statistics")),
    }
)
"""Every training, by name."""

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
"""What is compared with what, as in table 3."""


def table(results: Mapping[str, Scores]) -> str:
    """Scores beside the paper's, as Markdown, in the paper's groups.

    Args:
        results: Scores by row; rows without any are left blank.

    Returns:
        The table, with a line feed between its lines.
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
        tyro.conf.Positional[Path], tyro.conf.arg(metavar="FOLDER", help="Of all trainings.")
    ],
    rows: Annotated[tuple[str, ...], option("Which rows; all by default.", "ROW...")] = (),
    training: tyro.conf.OmitArgPrefixes[Training] = Training(),
) -> dict[str, Scores]:
    """Train every row, print the table beside the paper's and return the scores by row."""
    results = training.scores(training.sized(chosen(rows, ROWS)), folder)
    print(table(results))
    return results


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"


if __name__ == "__main__":
    main(run, __doc__)
