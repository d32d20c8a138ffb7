"""Cost of the networks of tables 2 and 3: parameters, FLOPs, time and memory.

    python -m experiments.efficiency_table > experiments/efficiency_table.md
    python -m experiments.efficiency_table --time --repeats 3 --networks cas_1 --size 128
    python -m experiments.efficiency_table --small                 (minutes)

Cost: half a minute. Only ``--time`` runs the networks, which at the paper's size needs a GPU (3 to
53 tera-operations an estimate). Expected: the paper's parameters and FLOPs; XLA counts 1 to 8 %
less, because it omits products with zero padding, of which a volume of nine candidates has many.
The result is committed as ``efficiency_table.md``.

FLOPs are counted twice: by the formula of ``experiments.flops`` and by XLA's cost analysis of the
lowered program. This analysis counts the body of a loop once, so it is applied to the network that
materialises its volumes, which has no loop, and not to the prediction in strips of ``occjax
estimate``.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp
import tyro
from tqdm import tqdm

from experiments.command_line import Small, announce_smoke_test, main
from experiments.flops import count_flops, count_parameters
from experiments.markdown import markdown_table
from experiments.measuring import Measurement, measure
from experiments.networks import (
    TABLE_2,
    TABLE_3,
    Published,
    candidate_intervals,
    candidate_numbers,
    small_form,
)
from occjax.errors import InputError
from occjax.models import OccCasNet, OccCasNetConfig, preset, variable_shapes

PAPER_SIZE_PX = 256
"""Height and width of the views in the paper's tables."""

ROWS = (*TABLE_2, *(name for name in TABLE_3 if name not in TABLE_2))


class Row(NamedTuple):
    """Cost of a network.

    Attributes:
        name: Name of the preset.
        network: The network.
        published: The paper's numbers; None for another image size.
        parameters: Number of values.
        flops: Operations by formula, counted as in the paper.
        flops_inside: Operations by formula without products with zero padding.
        flops_xla: Operations by XLA's analysis, which omits these products too.
        measured: Time and memory; None if they were not measured.
    """

    name: str
    network: OccCasNetConfig
    published: Published | None
    parameters: int
    flops: int
    flops_inside: int
    flops_xla: float
    measured: Measurement | None


def flops_by_xla(config: OccCasNetConfig, image_size: tuple[int, int]) -> float:
    """Return the floating-point operations of an estimate by XLA's cost analysis.

    Args:
        config: The network.
        image_size: ``(H, W)`` of the views, in pixels.

    Raises:
        RuntimeError: If the program has a loop, whose body would count only once.
    """
    views = jax.ShapeDtypeStruct((*config.views, *image_size), jnp.float32)
    truth = jax.ShapeDtypeStruct(image_size, jnp.float32)

    def disparity(variables, views, truth):
        return OccCasNet(config).apply(variables, views, ground_truth=truth)[-1].disparity

    lowered = jax.jit(disparity).lower(variable_shapes(config), views, truth)
    if "stablehlo.while" in lowered.as_text():
        raise RuntimeError("XLA counts the body of a loop once: count a program without loops")
    return lowered.cost_analysis()["flops"]


def table(rows: Sequence[Row]) -> str:
    """Return the costs as a Markdown table; columns without any value are omitted."""
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
            tera(row.flops_xla),
            f"{100 * (row.flops_inside / row.flops_xla - 1):+.1f} %",
            f"{measured.seconds:.3g}" if measured else "",
            f"{paper.seconds}" if paper and paper.seconds else "",
            f"{measured.memory / 1e9:.2f} GB" if measured else "",
        ]
        lines.append(cells)
    known = [any(column) for column in zip(*lines, strict=True)]
    head, *lines = ([*compress(line, known)] for line in (head, *lines))
    return markdown_table(head, lines)


def deviations(rows: Sequence[Row]) -> list[str]:
    """Return the published numbers that are not reproduced to the printed digits."""
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
    """Format a number of operations with three digits, in tera or giga."""
    return f"{flops / 1e12:#.3g} T" if flops >= 1e11 else f"{flops / 1e9:#.3g} G"


def mega(parameters: int) -> str:
    """Format a number of parameters with two decimals, in millions or thousands."""
    return f"{parameters / 1e6:.2f} M" if parameters >= 1e5 else f"{parameters / 1e3:.2f} k"


def run(
    size: Annotated[
        int, tyro.conf.arg(help="Height and width of the views, in pixels.")
    ] = PAPER_SIZE_PX,
    time: Annotated[bool, tyro.conf.arg(help="Measure time and memory too.")] = False,
    repeats: Annotated[int, tyro.conf.arg(help="Timed runs; the table has the median.")] = 10,
    networks: Annotated[tuple[str, ...], tyro.conf.arg(help="Presets; by default all rows.")] = (),
    small: Small = False,
) -> list[Row]:
    """Count parameters and operations, print the table and return its rows."""
    if small:
        size, time, repeats = 32, True, 1
        announce_smoke_test()
    if size < 1:
        raise InputError(f"--size must be 1 or more, not {size}")
    configs = {name: preset(name) for name in networks or ROWS}
    if small:
        configs = {name: small_form(config) for name, config in configs.items()}
    measured: dict[str, Measurement] = {}
    if time:  # before this process reserves the memory of a GPU
        for name, config in tqdm(configs.items(), unit="network", disable=None):
            measured[name] = measure(config, size, repeats=repeats)
    as_published = size == PAPER_SIZE_PX and not small
    rows = [
        Row(
            name,
            config,
            (TABLE_2.get(name) or TABLE_3.get(name)) if as_published else None,
            count_parameters(config),
            count_flops(config, (size, size)),
            count_flops(config, (size, size), padding=False),
            flops_by_xla(config, (size, size)),
            measured.get(name),
        )
        for name, config in configs.items()
    ]
    print(table(rows))
    if as_published:
        print(f"\n{_conclusion(rows)}")
    return rows


def _conclusion(rows: Sequence[Row]) -> str:
    apart = max(abs(row.flops_inside / row.flops_xla - 1) for row in rows)
    different = deviations(rows)
    sentences = (
        "9x9 views of 256x256 pixels; the paper's seconds are on an RTX 3090.",
        "A multiply-add is two operations. The features of all views count, and so do products "
        "with zero padding, which XLA omits.",
        f"Without them the formula and XLA differ by at most {100 * apart:.1f} %.",
        f"Not as published: {'; '.join(different)}."
        if different
        else "All published parameters and FLOPs are reproduced to the printed digits.",
    )
    return " ".join(sentences)


if __name__ == "__main__":
    main(run, __doc__)
