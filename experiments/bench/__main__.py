"""Time and memory of the published network in occjax, TensorFlow and PyTorch on this machine.

    python -m experiments.bench --output experiments/bench
    python -m experiments.bench --peer-python PYTHON --sizes 64 --repeats 5
    python -m experiments.bench --train --peer-python PYTHON          (steps of training)
    python -m experiments.bench --device gpu --output FOLDER          (bfloat16, both networks)
    python -m experiments.bench --device gpu --train --output FOLDER
    python -m experiments.bench --curves --output experiments/bench
    python -m experiments.bench --small --peers                       (a minute)

Cost: half an hour on two cores, less with ``--train`` or ``--curves``; minutes on a GPU, mostly for
compilation. Expected: occjax is not slower than the fastest peer. On an H100 in bfloat16, at most
40 ms for inference of 256 pixels, 170 ms and 8 GB for 512 pixels, and 10 ms for the proposal
network at 512 pixels; half of the matrix product's speed for inference, 45 % for a training step.
Measurements on an H200 are in docs/performance.md. The output folder gets ``benchmark.md`` and
``benchmark.json``, with ``--train`` ``training.md`` and ``training.json``, with ``--curves``
``curves.json`` and ``curves.png``.

The peers in ``experiments/bench/peers`` are the same network with the same weights in PyTorch and
TensorFlow (extra ``bench``). These may be installed in another environment, whose interpreter is
``--peer-python``; it needs no other package. Each candidate runs in its own process, and the
candidates take turns, so that other load on the machine affects all of them equally: ratios are
more reliable than times. A candidate is timed only after its answer agrees with the reference.
Inputs and weights are on the device before the clock starts; the clock stops when the answer is
computed, before it is copied to the host.

Operations per second refer to the network as published, although occjax computes fewer; a training
step counts three times the operations of inference. The percentage is relative to the product of
two 4096x4096 matrices (8192x8192 on a GPU) in the same precision, which takes turns too.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from itertools import compress
from pathlib import Path
from typing import Annotated

import jax
import numpy as np
import tyro

from experiments.bench import curves as curves_module
from experiments.bench.candidates import (
    FINEST_THRESHOLD,
    PEERS,
    PRODUCT,
    Device,
    compare_steps,
    inference_candidates,
    matrix_product_candidate,
    sample_candidates,
    training_candidates,
)
from experiments.bench.exchange import inference_problem, training_problem
from experiments.bench.processes import Timing, check_device, take_turns
from experiments.command_line import Small, announce_smoke_test, main
from experiments.cut_outs import small_sample
from experiments.markdown import markdown_table
from experiments.networks import SCORE_SCALE, small_form
from occjax.data.bundled_sample import sample
from occjax.errors import InputError
from occjax.estimators.factory import Precision
from occjax.evaluation import evaluate
from occjax.models import preset

SMALL_PRODUCT_SIDE = 256
"""Rows and columns of the matrices in a smoke test."""


def table(timings: Sequence[Timing]) -> str:
    """Return the timings as a Markdown table, without blank columns."""
    measures = dict.fromkeys(measure for timing in timings for measure in timing.differences)
    head = [
        *("pixels", "candidate", "seconds", "from", "to", "to the fastest peer's", "first call"),
        *("peak memory", "GFLOP/s", "of the product's", *measures),
    ]
    rows = []
    for timing in timings:
        same_size = {each.name: each for each in timings if each.size == timing.size}
        fastest = min((same_size[p].typical for p in PEERS if p in same_size), default=None)
        product = same_size[PRODUCT]
        counted = timing.flops is not None
        speed = (timing.flops or 0.0) / timing.typical
        share = speed / ((product.flops or 0.0) / product.typical)
        compared = fastest and timing is not product and counted
        rows.append(
            [
                "" if timing is product else str(timing.size),
                timing.name,
                *(f"{x:.3g}" for x in (timing.typical, min(timing.seconds), max(timing.seconds))),
                f"{timing.typical / fastest:.2f}" if compared else "",
                f"{timing.first:.3g}",
                f"{timing.memory / 1e9:.2f} GB",
                f"{speed / 1e9:.3g}" if counted else "",
                f"{100 * share:.0f} %" if counted else "",
                *(
                    f"{timing.differences[each]:.2g}" if timing.differences else ""
                    for each in measures
                ),
            ]
        )
    known = [any(column) for column in zip(*rows, strict=True)]
    head, *rows = ([*compress(line, known)] for line in (head, *rows))
    return markdown_table(head, rows, right=True)


def accuracy(precision: Precision, device: Device, side: int) -> tuple[str, list[Timing]]:
    """Measure the effect of a precision on the proposal network's BadPix of the sample."""
    truth = small_sample(side).ground_truth

    def bad_pixels(answer: np.ndarray, reference: np.ndarray) -> dict[str, float]:
        scores = {"float32": evaluate(reference, truth).badpix[FINEST_THRESHOLD]}
        scores[precision] = evaluate(answer, truth).badpix[FINEST_THRESHOLD]
        change = scores[precision] - scores["float32"]
        largest = float(np.abs(answer - reference).max())
        return {"change": change, "largest difference": largest, **scores}

    timings = take_turns(
        inference_problem(small_form(preset("occcasnet")), 16),
        sample_candidates(precision, side),
        repeats=1,
        device=device,
        compare=bad_pixels,
    )
    scores = timings[-1].differences
    return (
        f"BadPix {FINEST_THRESHOLD} of the proposal network on {side}x{side} pixels of the "
        "bundled sample: "
        f"{scores['float32']:.2f} % in float32, {scores[precision]:.2f} % in {precision}."
    ), timings


def run(
    sizes: Annotated[
        tuple[int, ...] | None,
        tyro.conf.arg(
            help="Heights and widths of the views, in pixels; by default 64 and 128, on a GPU 256 "
            "and 512, for training 32."
        ),
    ] = None,
    device: Annotated[Device, tyro.conf.arg(help="Device of all candidates.")] = "cpu",
    precision: Annotated[
        Precision | None,
        tyro.conf.arg(help="Number type of convolutions; by default float32, on a GPU bfloat16."),
    ] = None,
    train: Annotated[bool, tyro.conf.arg(help="Time training steps instead of inference.")] = False,
    batch: Annotated[
        int | None, tyro.conf.arg(help="Patches of a training step; by default 1, on a GPU 32.")
    ] = None,
    peers: Annotated[
        tuple[str, ...] | None,
        tyro.conf.arg(
            help=f"Some of {', '.join(PEERS)}; by default all that support the precision."
        ),
    ] = None,
    peer_python: Annotated[
        str, tyro.conf.arg(help="Interpreter that has the peers' frameworks.")
    ] = sys.executable,
    repeats: Annotated[int, tyro.conf.arg(help="Turns after the first run, which compiles.")] = 5,
    calls: Annotated[
        int | None,
        tyro.conf.arg(help="Runs in a turn; the median counts. By default 1, on a GPU 10."),
    ] = None,
    curves: Annotated[
        bool, tyro.conf.arg(help="Time only occjax, by pixels, candidates and views.")
    ] = False,
    output: Annotated[
        Path | None, tyro.conf.arg(aliases=["-o"], help="Folder for table, numbers and picture.")
    ] = None,
    small: Small = False,
) -> list[Timing]:
    """Time all candidates, print the table and return the timings."""
    on_gpu = device == "gpu"
    precision = precision or ("bfloat16" if on_gpu else "float32")
    sizes = sizes or ((32,) if train else (256, 512) if on_gpu else (64, 128))
    batch = batch or (32 if on_gpu else 1)
    calls = calls or (10 if on_gpu else 1)
    if peers is None:
        peers = tuple(name for name in PEERS if precision == "float32" or "torch" in name)
    if small:
        announce_smoke_test()
        sizes, repeats, batch = (16,), 1, 2
    if min(repeats, calls, batch) < 1 or min(sizes) < 2:
        raise InputError("--repeats, --calls and --batch must be 1 or more and --sizes 2 or more")
    for peer in peers:
        if peer not in PEERS:
            raise InputError(f"--peers: {peer} is unknown; choose from {', '.join(PEERS)}")
    check_device(device)
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
    if curves:
        return curves_module.run(output, small=small)
    config = preset("occcasnet")
    config = small_form(config) if small else config
    how = {"repeats": repeats, "calls": calls, "device": device, "peer_python": peer_python}
    product = matrix_product_candidate(device, precision, SMALL_PRODUCT_SIDE if small else None)
    timings = []
    for size in sizes:
        if train:
            candidates = training_candidates(config, size, batch, device, precision, peers)
            problem = training_problem(config, size, batch)
            timings += take_turns(problem, (product, *candidates), compare=compare_steps, **how)
        else:
            candidates = inference_candidates(config, size, device, precision, peers)
            problem = inference_problem(
                config, size, score_scale=(1000 if small else 1) * SCORE_SCALE
            )
            timings += take_turns(problem, (product, *candidates), **how)
    text = table(timings)
    if precision != "float32" and not train:
        side = 32 if small else max(sample().image_size)
        sentence, changed = accuracy(precision, device, side)
        text, timings = f"{text}\n\n{sentence}", timings + changed
    print(text)
    if output is not None:
        name = "training" if train else "benchmark"
        numbers = [timing.as_dict() for timing in timings]
        (output / f"{name}.json").write_text(json.dumps(numbers, indent=2) + "\n")
        (output / f"{name}.md").write_text(text + "\n")
    return timings


if __name__ == "__main__":
    jax.config.update("jax_platforms", "cpu")  # an accelerator is for the candidates
    main(run, __doc__)
