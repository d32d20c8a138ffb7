"""Candidates in processes of their own, run in turn."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tqdm import tqdm

from experiments.bench.exchange import describe, flatten
from experiments.bench.matrix_product import FLOPS
from experiments.bench.peers.description import save
from experiments.inference_work import random_light_field
from occjax.errors import InputError
from occjax.models import NetworkConfig
from occjax.models.work import count_flops

PRODUCT = "matrix product"
WRITTEN = "written"
"""The network as the paper describes it, to which all answers are compared."""


@dataclass(frozen=True)
class Timing:
    """What a candidate took.

    Attributes:
        name: Of the candidate.
        size: Height and width of the views, in pixels.
        first: Seconds of the first call, which compiles.
        seconds: Of each later call, in the order in which the candidates took turns.
        memory: Peak of its process in bytes, first call included.
        flops: Operations of the network as published (or the product's), whatever were done.
        largest: Largest difference of its disparity from that of the network as written.
        median: Median of the same.
    """

    name: str
    size: int
    first: float
    seconds: tuple[float, ...]
    memory: int
    flops: float
    largest: float | None = None
    median: float | None = None

    @property
    def typical(self) -> float:
        """Median of the seconds."""
        return statistics.median(self.seconds)

    def as_dict(self) -> dict:
        """For JSON."""
        return {**asdict(self), "typical": self.typical}


class Candidate:
    """A worker, see :mod:`experiments.bench.worker`."""

    def __init__(self, name: str, process: subprocess.Popen, python: str) -> None:
        self.name, self.process, self.python = name, process, python
        self.missing = self._answer().get("missing")

    def run(self) -> tuple[float, int]:
        """Seconds of one run, and the peak memory so far."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write("run\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            pass  # what it has to say is in its answer
        answer = self._answer()
        return answer["seconds"], answer["peak_memory"]

    def _answer(self) -> dict:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise InputError(
                f"{self.name} stopped with exit code {self.process.wait()} ({self.python}), as for "
                "lack of memory; pass smaller --sizes, or leave it out of --peers"
            )
        return json.loads(line)


@contextmanager
def started(name: str, folder: Path, python: str) -> Iterator[Candidate]:
    """A candidate that is ready to run; it ends with the block."""
    command = [python, "-m", "experiments.bench.worker", name, str(folder)]
    environment = {"TF_CPP_MIN_LOG_LEVEL": "2", **os.environ, "JAX_PLATFORMS": "cpu"}
    pipe = subprocess.PIPE
    try:
        process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment)
    except OSError as error:
        raise InputError(f"--peer-python: {python} cannot be run: {error.strerror}") from error
    try:
        yield Candidate(name, process, python)
    finally:
        process.kill()
        process.communicate()


def take_turns(
    config: NetworkConfig,
    size: int,
    names: Sequence[str],
    *,
    repeats: int,
    peer_python: str = sys.executable,
) -> list[Timing]:
    """Time candidates on one light field, in turn, so that other work slows all alike.

    Args:
        config: The network.
        size: Height and width of the views, in pixels.
        names: Of the candidates, as in :data:`experiments.bench.worker.BUILDERS`.
        repeats: Turns after a first one, which compiles.
        peer_python: Interpreter of the peers.

    Returns:
        One timing for each candidate, in the order of the names. With :data:`WRITTEN` among them,
        the differences from its answer.

    Raises:
        InputError: If a candidate's framework is not installed or its process dies.
    """
    ours = (PRODUCT, WRITTEN, "occjax")
    with TemporaryDirectory() as place, ExitStack() as stack:
        folder = Path(place)
        variables, views = random_light_field(config, size, size)
        save(folder, describe(config), flatten(variables), np.asarray(views))
        candidates = []
        for name in names:
            python = sys.executable if name in ours else peer_python
            candidate = stack.enter_context(started(name, folder, python))
            if candidate.missing:
                raise InputError(
                    f"{name}: {python} has no module {candidate.missing}; install it there, pass "
                    f"the --peer-python that has it, or leave {name} out of --peers"
                )
            candidates.append(candidate)
        turns = [
            [candidate.run() for candidate in candidates]
            for _ in tqdm(range(1 + repeats), unit="turn", desc=f"{size} pixels", disable=None)
        ]
        disparities = {name: np.load(folder / f"{name}.npy") for name in names}
    timings = []
    flops = count_flops(config, (size, size))
    for name, runs in zip(names, zip(*turns, strict=True), strict=True):
        seconds, memory = zip(*runs, strict=True)
        largest = median = None
        if WRITTEN in names and name not in (PRODUCT, WRITTEN):
            apart = np.abs(disparities[name] - disparities[WRITTEN])
            largest, median = float(apart.max()), float(np.median(apart))
        timings.append(
            Timing(
                *(name, size, seconds[0], seconds[1:], memory[-1]),
                flops=FLOPS if name == PRODUCT else flops,
                largest=largest,
                median=median,
            )
        )
    return timings
