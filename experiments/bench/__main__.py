"""Time and memory of the published network: occjax beside TensorFlow and PyTorch on this machine.

    python -m experiments.bench --output experiments/bench
    python -m experiments.bench --peer-python PYTHON --sizes 64 --repeats 5
    python -m experiments.bench --train --peer-python PYTHON          (steps of training)
    python -m experiments.bench --device gpu --output FOLDER          (bfloat16, light network too)
    python -m experiments.bench --device gpu --train --output FOLDER
    python -m experiments.bench --curves --output experiments/bench
    python -m experiments.bench --small --peers                       (a minute, for the test)

Cost: on two cores half an hour, ``--train`` and the curves less; on a GPU minutes, most of them
to compile. Expected: occjax takes no longer than the fastest peer. On an H100 in bfloat16:
inference of 256 pixels 40 ms and of 512 pixels 170 ms at most, half of the matrix product's speed
and no more than 8 GB; the light network 10 ms at 512 pixels; a step of training 45 % of the
product's speed. What an H200 needed is in docs/performance.md. ``benchmark.md`` and
``benchmark.json``, with ``--train`` ``training.md`` and ``training.json`` (``curves.json``,
``curves.png``) are written to the output folder.

The peers are the same network with the same weights, written for this comparison in
``experiments/bench/peers``. They need PyTorch and TensorFlow (extra ``bench``), which may be
installed elsewhere: ``--peer-python`` is the interpreter of such an environment; it needs nothing
else. Each candidate has a process of its own, and they take turns, so that other work on the
machine slows all alike: a ratio of two means more than either. None is timed before its answer
agrees. Inputs and weights lie where they are computed with before the clock starts, and it stops
when the answer is there, not copied back.

Operations per second are those of the network as published, though occjax does fewer of them; a
step of training has three times those of inference. The share is of a matrix product of 4096x4096,
on a GPU of 8192x8192, in the same precision, which takes turns too.
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

from experiments.bench import curves as curve
from experiments.bench.candidates import (
    BAD,
    PEERS,
    PRODUCT,
    Device,
    for_inference,
    for_training,
    of_sample,
    of_step,
)
from experiments.bench.exchange import inference_problem, training_problem
from experiments.bench.processes import Timing, check_device, take_turns
from experiments.command_line import main
from experiments.cut_outs import cut_out
from experiments.markdown import markdown_table
from experiments.networks import SCORES, small_form
from occjax.data.sample import sample
from occjax.errors import InputError
from occjax.evaluation import bad_pix
from occjax.models import preset
from occjax.training.config import Precision


def table(timings: Sequence[Timing]) -> str:
    """Timings as a Markdown table, those of one size one after the other; no blank columns."""
    measures = dict.fromkeys(measure for timing in timings for measure in timing.apart)
    head = [
        *("pixels", "candidate", "seconds", "from", "to", "to the fastest peer's", "first call"),
        *("peak memory", "GFLOP/s", "of the product's", *measures),
    ]
    rows = []
    for timing in timings:
        beside = {each.name: each for each in timings if each.size == timing.size}
        fastest = min((beside[name].typical for name in PEERS if name in beside), default=None)
        product = beside[PRODUCT]
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
                *(f"{timing.apart[each]:.2g}" if timing.apart else "" for each in measures),
            ]
        )
    known = [any(column) for column in zip(*rows, strict=True)]
    head, *rows = ([*compress(line, known)] for line in (head, *rows))
    return markdown_table(head, rows, right=True)


def accuracy(precision: Precision, device: Device, side: int) -> tuple[str, list[Timing]]:
    """What the light network loses to a precision on the bundled sample, in a sentence."""
    truth = cut_out(sample(), side).ground_truth

    def bad_pixels(answer: np.ndarray, reference: np.ndarray) -> dict[str, float]:
        scores = {"float32": bad_pix(reference, truth, BAD), precision: bad_pix(answer, truth, BAD)}
        change = scores[precision] - scores["float32"]
        apart = float(np.abs(answer - reference).max())
        return {"change": change, "largest difference": apart, **scores}

    timings = take_turns(
        inference_problem(small_form(preset("occcasnet")), 16),
        of_sample(precision, side),
        repeats=1,
        device=device,
        compare=bad_pixels,
    )
    scores = timings[-1].apart
    return (
        f"BadPix {BAD} of the light network on {side}x{side} pixels of the bundled sample: "
        f"{scores['float32']:.2f} % in float32, {scores[precision]:.2f} % in {precision}."
    ), timings


def run(
    sizes: Annotated[
        tuple[int, ...] | None,
        tyro.conf.arg(
            help="Heights and widths of the views, pixels; by default 64 and 128, on a GPU 256 and "
            "512, for training 32."
        ),
    ] = None,
    device: Annotated[Device, tyro.conf.arg(help="Where to compute.")] = "cpu",
    precision: Annotated[
        Precision | None,
        tyro.conf.arg(help="Of the convolutions; by default float32, on a GPU bfloat16."),
    ] = None,
    train: Annotated[
        bool, tyro.conf.arg(help="Time steps of training in place of inference.")
    ] = False,
    batch: Annotated[
        int | None,
        tyro.conf.arg(help="Patches of a step of training; by default 1, on a GPU 32."),
    ] = None,
    peers: Annotated[
        tuple[str, ...] | None,
        tyro.conf.arg(
            help=f"Which of {', '.join(PEERS)}; by default all that compute in the precision."
        ),
    ] = None,
    peer_python: Annotated[
        str, tyro.conf.arg(help="Interpreter that has the peers' frameworks.")
    ] = sys.executable,
    repeats: Annotated[int, tyro.conf.arg(help="Turns after the first run, which compiles.")] = 5,
    calls: Annotated[
        int | None,
        tyro.conf.arg(help="Runs in a turn, whose median counts; by default 1, on a GPU 10."),
    ] = None,
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
    on_gpu = device == "gpu"
    precision = precision or ("bfloat16" if on_gpu else "float32")
    sizes = sizes or ((32,) if train else (256, 512) if on_gpu else (64, 128))
    batch = batch or (32 if on_gpu else 1)
    calls = calls or (10 if on_gpu else 1)
    if peers is None:
        peers = tuple(name for name in PEERS if precision == "float32" or "torch" in name)
    if small:
        sizes, repeats, batch = (16,), 1, 2
    if min(repeats, calls, batch) < 1 or min(sizes) < 2:
        raise InputError("--repeats, --calls and --batch must be 1 or more and --sizes 2 or more")
    for peer in peers:
        if peer not in PEERS:
            raise InputError(f"--peers: there is no {peer}; there are {', '.join(PEERS)}")
    check_device(device)
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
    if curves:
        return curve.run(output, small=small)
    config = preset("occcasnet")
    config = small_form(config) if small else config
    how = {"repeats": repeats, "calls": calls, "device": device, "peer_python": peer_python}
    timings = []
    for size in sizes:
        if train:
            candidates = for_training(config, size, batch, device, precision, peers)
            problem = training_problem(config, size, batch)
            timings += take_turns(problem, candidates, compare=of_step, **how)
        else:
            candidates = for_inference(config, size, device, precision, peers)
            problem = inference_problem(config, size, scores=1000 * SCORES if small else SCORES)
            timings += take_turns(problem, candidates, **how)
    text = table(timings)
    if precision != "float32" and not train:
        sentence, lost = accuracy(precision, device, 64 if small else max(sample().image_size))
        text, timings = f"{text}\n\n{sentence}", timings + lost
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
