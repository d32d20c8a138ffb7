"""Candidates in processes of their own, run in turn."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tqdm import tqdm

from experiments.bench.candidates import Candidate, Comparison, Device, of_disparity
from experiments.bench.peers.description import Problem, save
from occjax.errors import InputError

REST = 0.5
"""Seconds between turns: threads of the candidate before wait for more work busily for a while."""

PLATFORMS = {"cpu": "cpu", "gpu": "cuda"}


@dataclass(frozen=True)
class Timing:
    """What a candidate took.

    Attributes:
        name: Of the candidate.
        size: Height and width of the views, in pixels.
        first: Seconds of the first run, which compiles.
        seconds: Of a run in each later turn, in the order in which the candidates took turns.
        memory: Peak in bytes, first run included: of the accelerator or, without one, the process.
        flops: Operations of the network as published (or the product's), whatever were done.
        apart: How far its answer is from its reference, by the name of the measure.
    """

    name: str
    size: int
    first: float
    seconds: tuple[float, ...]
    memory: int
    flops: float | None
    apart: dict[str, float] = field(default_factory=dict)

    @property
    def typical(self) -> float:
        """Median of the seconds."""
        return statistics.median(self.seconds)

    def as_dict(self) -> dict:
        """For JSON."""
        return {**asdict(self), "typical": self.typical}


class Worker:
    """A candidate's process, see :mod:`experiments.bench.worker`."""

    def __init__(self, name: str, process: subprocess.Popen, python: str) -> None:
        self.name, self.process, self.python = name, process, python
        self.missing = self._answer().get("missing")

    def run(self, calls: int) -> tuple[list[float], int]:
        """Seconds of each of some runs, and the peak memory so far."""
        time.sleep(REST)
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(f"{calls}\n")
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
                "lack of memory, or of a GPU that a peer's framework can use; pass smaller "
                "--sizes, or leave a peer out of --peers"
            )
        return json.loads(line)


def check_device(device: Device) -> None:
    """Refuse an accelerator that JAX does not see, before anything is started on it.

    Raises:
        InputError: With what can be done about it.
    """
    if device == "cpu":
        return
    environment = {**os.environ, "JAX_PLATFORMS": PLATFORMS[device]}
    look = [sys.executable, "-c", "import jax; jax.devices()"]
    if subprocess.run(look, env=environment, capture_output=True, check=False).returncode:
        raise InputError(
            f"--device {device}: JAX sees none on this machine; with a driver, "
            "pip install 'occjax[gpu]', else leave the option out"
        )


@contextmanager
def started(candidate: Candidate, folder: Path, python: str, device: Device) -> Iterator[Worker]:
    """A candidate that is ready to run; it ends with the block."""
    command = [
        *(python, "-m", "experiments.bench.worker", candidate.name),
        *(f"experiments.bench.{candidate.module}", candidate.function),
        *(json.dumps(dict(candidate.options)), str(folder)),
    ]
    # Candidates share an accelerator: none may reserve all of its memory.
    shares = {"XLA_PYTHON_CLIENT_PREALLOCATE": "false", "TF_FORCE_GPU_ALLOW_GROWTH": "true"}
    environment = {"TF_CPP_MIN_LOG_LEVEL": "2", **os.environ, **shares}
    environment["JAX_PLATFORMS"] = PLATFORMS[device]
    if device == "cpu":
        environment["CUDA_VISIBLE_DEVICES"] = ""
    pipe = subprocess.PIPE
    try:
        process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment)
    except OSError as error:
        raise InputError(f"--peer-python: {python} cannot be run: {error.strerror}") from error
    try:
        yield Worker(candidate.name, process, python)
    finally:
        process.kill()
        process.communicate()


def take_turns(
    problem: Problem,
    candidates: Sequence[Candidate],
    *,
    repeats: int,
    calls: int = 1,
    device: Device = "cpu",
    peer_python: str = sys.executable,
    compare: Comparison = of_disparity,
) -> list[Timing]:
    """Time candidates on one problem, in turn, so that other work slows all alike.

    Args:
        problem: What they compute.
        candidates: Who takes part.
        repeats: Turns after a first run of each, which compiles.
        calls: Runs of a candidate in a turn, of which the median counts: an accelerator wakes up
            with the first of them.
        device: Where they run.
        peer_python: Interpreter of the peers.
        compare: Of an answer with that of the reference.

    Returns:
        One timing for each candidate, in their order.

    Raises:
        InputError: If a candidate's framework is not installed or its process dies.
        RuntimeError: If an answer is not that of its reference.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        save(folder, problem)
        workers = []
        for candidate in candidates:
            python = peer_python if candidate.peer else sys.executable
            worker = stack.enter_context(started(candidate, folder, python, device))
            if worker.missing:
                raise InputError(
                    f"{candidate.name}: {python} has no module {worker.missing}; install it there, "
                    f"pass the --peer-python that has it, or leave {candidate.name} out of --peers"
                )
            workers.append(worker)
        firsts = [worker.run(1) for worker in workers]
        apart = agreement(candidates, folder, compare)
        turns = [
            [worker.run(calls) for worker in workers]
            for _ in tqdm(
                range(repeats), unit="turn", desc=f"{problem.views.shape[-1]} pixels", disable=None
            )
        ]
    timings = []
    for index, candidate in enumerate(candidates):
        (first,), memory = firsts[index]
        seconds = tuple(statistics.median(turn[index][0]) for turn in turns)
        memory = turns[-1][index][1] if turns else memory
        timings.append(
            Timing(
                *(candidate.name, problem.views.shape[-1], first, seconds, memory),
                *(candidate.flops, apart[candidate.name]),
            )
        )
    return timings


def agreement(
    candidates: Sequence[Candidate], folder: Path, compare: Comparison
) -> dict[str, dict[str, float]]:
    """How far the first answers are from those of their references, by candidate and measure.

    Raises:
        RuntimeError: If one is farther than its bound.
    """
    answers = {
        candidate.name: np.load(folder / f"{candidate.name}.npy") for candidate in candidates
    }
    found: dict[str, dict[str, float]] = {}
    for candidate in candidates:
        found[candidate.name] = {}
        if candidate.reference is None:
            continue
        measures = dict(compare(answers[candidate.name], answers[candidate.reference]))
        found[candidate.name] = measures
        for measure, bound in candidate.bounds.items():
            if not measures[measure] <= bound:
                raise RuntimeError(
                    f"{candidate.name} is not {candidate.reference}: {measure} "
                    f"{measures[measure]:.1e}, more than {bound:.0e}"
                )
    return found
