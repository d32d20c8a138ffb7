"""Time and memory of occjax by image size, number of candidates and number of views."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from experiments.bench.candidates import Candidate
from experiments.bench.exchange import inference_problem
from experiments.bench.processes import Timing, take_turns
from experiments.networks import small_form
from occjax.models import OccCasNetConfig, preset

SIZES = (64, 128, 256, 512)
CANDIDATES = (9, 17, 33, 81)
SIDES = (5, 7, 9)
FIXED_SIZE_PX = 64
"""Height and width of the views for varying candidates and views."""

Curve = Mapping[int, Timing]
"""Timings by the varied quantity."""


def with_candidates(config: OccCasNetConfig, number: int) -> OccCasNetConfig:
    """Return the network with a number of candidates in its first stage, over the same range."""
    first, *others = config.stages
    ends = first.candidates[0], first.candidates[-1]
    first = dataclasses.replace(first, candidates=tuple(np.linspace(*ends, number)))
    return dataclasses.replace(config, stages=(first, *others))


def run(output: Path | None, *, small: bool = False) -> list[Timing]:
    """Time occjax, write numbers and figure to the folder if there is one, return all timings."""
    config = preset("occcasnet")
    sizes, numbers, sides = SIZES, CANDIDATES, SIDES
    if small:
        config, sizes, numbers, sides = small_form(config), (8, 16), (2, 3), (3, 5)

    def timed(config: OccCasNetConfig, size: int) -> Timing:
        candidates = (Candidate("occjax", "ours", "build"),)
        (timing,) = take_turns(inference_problem(config, size), candidates, repeats=1)
        return timing

    size = 8 if small else FIXED_SIZE_PX
    curves: dict[str, Curve] = {
        "height and width, pixels": {size: timed(config, size) for size in sizes},
        "candidates of the first stage": {
            number: timed(with_candidates(config, number), size) for number in numbers
        },
        "views": {
            side**2: timed(dataclasses.replace(config, views=(side, side)), size) for side in sides
        },
    }
    for name, curve in curves.items():
        for value, timing in curve.items():
            memory = timing.memory / 1e9
            print(f"{name} {value}: {timing.typical:.3g} s, {memory:.2f} GB")
    if output is not None:
        numbers_by_name = {
            name: {value: timing.as_dict() for value, timing in curve.items()}
            for name, curve in curves.items()
        }
        (output / "curves.json").write_text(json.dumps(numbers_by_name, indent=2) + "\n")
        draw(curves, output / "curves.png")
    return [timing for curve in curves.values() for timing in curve.values()]


def draw(curves: Mapping[str, Curve], path: Path) -> None:
    """Draw one panel for each varied quantity, with seconds on the left and memory on the right."""
    figure, panels = plt.subplots(1, len(curves), figsize=(12, 3.6), layout="constrained")
    for panel, (name, curve) in zip(panels, curves.items(), strict=True):
        values = list(curve)
        memory = panel.twinx()
        _plot(panel, values, [each.typical for each in curve.values()], "C0", "seconds")
        _plot(memory, values, [each.memory / 1e9 for each in curve.values()], "C1", "peak, GB")
        panel.set_xscale("log", base=2)
        panel.set_xticks(values, [str(value) for value in values])
        panel.minorticks_off()
        panel.set_xlabel(name)
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _plot(axes, values: Sequence[int], heights: Sequence[float], colour: str, label: str) -> None:
    axes.plot(values, heights, color=colour, marker="o")
    axes.set_ylabel(label, color=colour)
    axes.set_ylim(bottom=0)
