"""What the networks of tables 2 and 3 cost: parameters, FLOPs, time and memory.

    python -m experiments.efficiency_table > experiments/efficiency_table.md
    python -m experiments.efficiency_table --time --repeats 3 --networks cas_1 --size 128
    python -m experiments.efficiency_table --small                 (minutes, for the test)

Cost: half a minute, since nothing is computed but with ``--time``, which runs every network; the
paper's size wants a GPU (3 to 53 tera-operations an estimate). Expected: parameters and FLOPs as
printed in the paper; XLA counts 1 to 8 % less, because it leaves out products with the zeros
around an image, of which a volume of nine candidates has many. The result is committed beside this
file.

FLOPs are counted twice, by the formula of ``occjax.models.work`` and by XLA's analysis of the
lowered program. That analysis counts the body of a loop once, so it is given the network whose
volumes are computed at once, in which there is no loop, not the one in strips that ``occjax
estimate`` runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp
import tyro
from tqdm import tqdm

from experiments.command_line import main
from experiments.markdown import markdown_table
from experiments.measuring import Measured, measure
from experiments.networks import (
    TABLE_2,
    TABLE_3,
    Published,
    candidate_intervals,
    candidate_numbers,
    small_form,
)
from occjax.errors import InputError
from occjax.models import NetworkConfig, OccCasNet, preset, variable_shapes
from occjax.models.config import of_kind
from occjax.models.work import count_flops, count_parameters

PAPER_SIZE = 256
"""Height and width for which the paper's tables count."""

SMALLER = (
    "The formula leaves out sampling, occlusion weights and regression, which are less than a "
    "hundredth of the paper's networks at its size but more of smaller ones."
)

ROWS = (*TABLE_2, *(name for name in TABLE_3 if name not in TABLE_2))


class Row(NamedTuple):
    """A network and what it costs.

    Attributes:
        name: Of the preset.
        network: The network.
        published: What the paper prints, if this is the paper's size.
        parameters: Number of values.
        flops: By formula, counted as in the paper.
        inside: By formula, without products with the zeros around an image.
        xla: As XLA counts, which leaves them out too.
        measured: Time and memory, if they were measured.
    """

    name: str
    network: NetworkConfig
    published: Published | None
    parameters: int
    flops: int
    inside: int
    xla: float
    measured: Measured | None


def flops_by_xla(config: NetworkConfig, size: int) -> float:
    """Floating-point operations of one estimate, as XLA's analysis of the program has it.

    Args:
        config: A network of a grid of views.
        size: Height and width, in pixels.

    Returns:
        Their number.

    Raises:
        RuntimeError: If the program has a loop, whose body would count once only.
    """
    views = jax.ShapeDtypeStruct((*of_kind(config.views, tuple), size, size), jnp.float32)
    truth = jax.ShapeDtypeStruct((size, size), jnp.float32)

    def disparity(variables, views, truth):
        outputs = OccCasNet(config).apply(variables, views, ground_truth=truth)
        return of_kind(outputs, tuple)[-1].disparity

    lowered = jax.jit(disparity).lower(variable_shapes(config), views, truth)
    if "stablehlo.while" in lowered.as_text():
        raise RuntimeError("XLA counts the body of a loop once: count a program without loops")
    return of_kind(lowered.cost_analysis(), dict)["flops"]


def table(rows: Sequence[Row]) -> str:
    """Costs as a Markdown table.

    Args:
        rows: The networks.

    Returns:
        The table, with a line feed between its lines, without columns that would be blank.
    """
    head = [
        *("network", "preset", "candidates", "intervals", "parameters", "parameters (paper)"),
        *("FLOPs", "FLOPs (paper)", "by XLA", "formula without padding"),
        *("seconds", "seconds (paper)", "peak memory"),
    ]
    lines = []
    for row in rows:
        paper, measured = row.published, row.measured
        cells = [
            paper.name if paper else "",
            f"`{row.name}`",
            candidate_numbers(row.network),
            candidate_intervals(row.network),
            mega(row.parameters),
            f"{paper.parameters} M" if paper else "",
            tera(row.flops),
            f"{paper.tera_flops} T" if paper else "",
            tera(row.xla),
            f"{100 * (row.inside / row.xla - 1):+.1f} %",
            f"{measured.seconds:.3g}" if measured else "",
            f"{paper.seconds}" if paper and paper.seconds else "",
            f"{measured.memory / 1e9:.2f} GB" if measured else "",
        ]
        lines.append(cells)
    known = [any(column) for column in zip(*lines, strict=True)]
    head, *lines = ([*compress(line, known)] for line in (head, *lines))
    return markdown_table(head, lines)


def deviations(rows: Sequence[Row]) -> list[str]:
    """Which published numbers do not come out to the printed digits, and by how much."""
    found = []
    for row in rows:
        if row.published is None:
            continue
        ours = {"parameters": f"{row.parameters / 1e6:.2f}", "FLOPs": tera(row.flops)[:-2]}
        theirs = {"parameters": row.published.parameters, "FLOPs": row.published.tera_flops}
        for what, value in theirs.items():
            if ours[what] != value:
                percent = 100 * (float(ours[what]) / float(value) - 1)
                found.append(f"{row.name}: {what} {ours[what]}, not {value} ({percent:+.1f} %)")
    return found


def tera(flops: float) -> str:
    """A number of operations in three digits; small networks have less than a tera."""
    return f"{flops / 1e12:#.3g} T" if flops >= 1e11 else f"{flops / 1e9:#.3g} G"


def mega(parameters: int) -> str:
    """A number of parameters as the paper prints it; small networks have less than a million."""
    return f"{parameters / 1e6:.2f} M" if parameters >= 1e5 else f"{parameters / 1e3:.2f} k"


def run(
    size: Annotated[int, tyro.conf.arg(help="Height and width of the views, pixels.")] = PAPER_SIZE,
    time: Annotated[
        bool, tyro.conf.arg(help="Run every network, for its time and memory.")
    ] = False,
    repeats: Annotated[int, tyro.conf.arg(help="Timed runs of each, of which the median.")] = 10,
    networks: Annotated[tuple[str, ...], tyro.conf.arg(help="Presets; all rows by default.")] = (),
    small: Annotated[
        bool, tyro.conf.arg(help="Networks of 3x3 views and few channels at 32 pixels, run once.")
    ] = False,
) -> list[Row]:
    """Count, and measure if asked to; print the table and return its rows."""
    if small:
        size, time, repeats = 32, True, 1
    if size < 1:
        raise InputError(f"--size must be 1 or more, not {size}")
    configs = {name: preset(name) for name in networks or ROWS}
    if small:
        configs = {name: small_form(config) for name, config in configs.items()}
    measured: dict[str, Measured] = {}
    if time:  # before this process takes a GPU
        for name, config in tqdm(configs.items(), unit="network", disable=None):
            measured[name] = measure(config, size, repeats=repeats)
    as_published = size == PAPER_SIZE and not small
    rows = [
        Row(
            name,
            config,
            (TABLE_2.get(name) or TABLE_3.get(name)) if as_published else None,
            count_parameters(config),
            count_flops(config, (size, size)),
            count_flops(config, (size, size), padding=False),
            flops_by_xla(config, size),
            measured.get(name),
        )
        for name, config in configs.items()
    ]
    print(table(rows))
    print(f"\n{_conclusion(rows) if as_published else SMALLER}")
    return rows


def _conclusion(rows: Sequence[Row]) -> str:
    apart = max(abs(row.inside / row.xla - 1) for row in rows)
    different = deviations(rows)
    sentences = (
        "9x9 views of 256x256 pixels; seconds in the paper on an RTX 3090.",
        "A multiply-add is two operations, the features are those of all views, and products with "
        "the zeros around an image count, but not for XLA.",
        f"Without those the formula and XLA differ by {100 * apart:.1f} % at most.",
        f"Not as published: {'; '.join(different)}."
        if different
        else "All published parameters and FLOPs come out to the printed digits.",
    )
    return " ".join(sentences)


if __name__ == "__main__":
    main(run, __doc__)
