"""Time and memory of the published network: occjax beside TensorFlow and PyTorch on this machine.

    python -m experiments.bench --output experiments/bench
    python -m experiments.bench --peer-python PYTHON --sizes 64 --repeats 5
    python -m experiments.bench --curves --output experiments/bench
    python -m experiments.bench --small --peers                       (a minute, for the test)

Cost: on two cores half an hour, the curves an hour more. Expected: occjax takes no longer than the
fastest peer, and the answers differ by less than 1e-4. ``benchmark.md`` and ``benchmark.json``
(``curves.json``, ``curves.png``) are written to the output folder.

The peers are the same network with the same weights, written for this comparison in
``experiments/bench/peers``. They need PyTorch and TensorFlow, which may be installed elsewhere:
``--peer-python`` is the interpreter of such an environment; it needs nothing else. Each candidate
has a process of its own, and they take turns, so that other work on the machine slows all alike: a
ratio of two means more than either.

Operations per second are those of the network as published, though occjax does fewer of them; the
share is of a matrix product of 4096x4096, which takes turns too.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from experiments.bench import curves as curve
from experiments.bench.processes import PRODUCT, WRITTEN, Timing, take_turns
from experiments.command_line import main
from experiments.markdown import markdown_table
from experiments.networks import small_form
from occjax.errors import InputError
from occjax.models import preset

PEERS = ("torch", "tensorflow")


def table(timings: Sequence[Timing]) -> str:
    """Timings as a Markdown table; those of one size one after the other."""
    head = [
        *("pixels", "candidate", "seconds", "from", "to", "to the fastest peer's", "first call"),
        *("peak memory", "GFLOP/s", "of the product's", "largest difference", "median"),
    ]
    rows = []
    for timing in timings:
        beside = {each.name: each for each in timings if each.size == timing.size}
        fastest = min((beside[name].typical for name in PEERS if name in beside), default=None)
        product = beside[PRODUCT]
        speed = timing.flops / timing.typical
        share = speed / (product.flops / product.typical)
        compared = timing.largest is not None
        rows.append(
            [
                "" if timing is product else str(timing.size),
                timing.name,
                *(f"{x:.3g}" for x in (timing.typical, min(timing.seconds), max(timing.seconds))),
                f"{timing.typical / fastest:.2f}" if fastest and timing is not product else "",
                f"{timing.first:.3g}",
                f"{timing.memory / 1e9:.2f} GB",
                f"{speed / 1e9:.3g}",
                f"{100 * share:.0f} %",
                f"{timing.largest:.0e}" if compared else "",
                f"{timing.median:.0e}" if compared else "",
            ]
        )
    return markdown_table(head, rows, right=True)


def run(
    sizes: Annotated[
        tuple[int, ...], tyro.conf.arg(help="Heights and widths of the views, pixels.")
    ] = (64, 128),
    peers: Annotated[tuple[str, ...], tyro.conf.arg(help="Which of torch, tensorflow.")] = PEERS,
    peer_python: Annotated[
        str, tyro.conf.arg(help="Interpreter that has the peers' frameworks.")
    ] = sys.executable,
    repeats: Annotated[int, tyro.conf.arg(help="Turns after the first, which compiles.")] = 5,
    curves: Annotated[
        bool, tyro.conf.arg(help="Instead, occjax alone by pixels, candidates and views.")
    ] = False,
    output: Annotated[
        Path | None, tyro.conf.arg(aliases=["-o"], help="Folder for table, numbers and picture.")
    ] = None,
    small: Annotated[
        bool, tyro.conf.arg(help="A network of 3x3 views and few channels at 16 pixels, one turn.")
    ] = False,
) -> list[Timing]:
    """Time all candidates, print the table and return the timings."""
    if small:
        sizes, repeats = (16,), 1
    if repeats < 1 or not sizes or min(sizes) < 2:
        raise InputError("--repeats must be 1 or more and --sizes 2 or more")
    for peer in peers:
        if peer not in PEERS:
            raise InputError(f"--peers: there is no {peer}; there are {', '.join(PEERS)}")
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
    if curves:
        return curve.run(output, small=small)
    config = preset("occcasnet")
    config = small_form(config) if small else config
    names = (PRODUCT, WRITTEN, *peers, "occjax")
    timings = [
        timing
        for size in sizes
        for timing in take_turns(config, size, names, repeats=repeats, peer_python=peer_python)
    ]
    text = table(timings)
    print(text)
    if output is not None:
        numbers = [timing.as_dict() for timing in timings]
        (output / "benchmark.json").write_text(json.dumps(numbers, indent=2) + "\n")
        (output / "benchmark.md").write_text(text + "\n")
    return timings


if __name__ == "__main__":
    main(run, __doc__)
