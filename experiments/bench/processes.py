"""Timing of candidates, which run in separate processes by turns."""

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

from experiments.bench.candidates import Candidate, Comparison, Device, compare_disparities
from experiments.bench.peers.description import Problem, save
from occjax.errors import InputError

PAUSE_SECONDS = 0.5
"""Pause between turns, in which the spinning threads of the previous candidate go to sleep."""

PLATFORMS = {"cpu": "cpu", "gpu": "cuda"}


@dataclass(frozen=True)
class Timing:
    """Time and memory of a candidate.

    Attributes:
        name: Name of the candidate.
        size: Height and width of the views, in pixels.
        first: Seconds of the first run, which compiles.
        seconds: Seconds of a run in each later turn.
        memory: Peak memory in bytes, including the first run: of the accelerator, or without one
            of the process.
        flops: Operations of the network as published, or of the matrix product.
        differences: Differences of the answer from its reference, by measure.
    """

    name: str
    size: int
    first: float
    seconds: tuple[float, ...]
    memory: int
    flops: float | None
    differences: dict[str, float] = field(default_factory=dict)

    @property
    def typical(self) -> float:
        """Median of the seconds."""
        return statistics.median(self.seconds)

    def as_dict(self) -> dict:
        """Return the values for JSON."""
        return {**asdict(self), "typical": self.typical}


class Worker:
    """Process of a candidate, see :mod:`experiments.bench.worker`."""

    def __init__(self, name: str, process: subprocess.Popen, python: str) -> None:
        self.name, self.process, self.python = name, process, python
        self.missing = self._answer().get("missing")

    def run(self, calls: int) -> tuple[list[float], int]:
        """Run the candidate; return the seconds of each run, and the peak memory so far."""
        time.sleep(PAUSE_SECONDS)
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(f"{calls}\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            pass  # reading the answer reports the failure
        answer = self._answer()
        return answer["seconds"], answer["peak_memory"]

    def _answer(self) -> dict:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise InputError(
                f"{self.name} stopped with exit code {self.process.wait()} ({self.python}): memory "
                "or a GPU that its framework supports may be missing; pass smaller --sizes, or "
                "remove a peer from --peers"
            )
        return json.loads(line)


def check_device(device: Device) -> None:
    """Check that JAX finds the device.

    Raises:
        InputError: If JAX does not find it.
    """
    if device == "cpu":
        return
    environment = {**os.environ, "JAX_PLATFORMS": PLATFORMS[device]}
    look = [sys.executable, "-c", "import jax; jax.devices()"]
    if subprocess.run(look, env=environment, capture_output=True, check=False).returncode:
        raise InputError(
            f"--device {device}: JAX finds none on this machine; if it has one, "
            "pip install 'occjax[gpu]', otherwise remove the option"
        )


@contextmanager
def started(candidate: Candidate, folder: Path, python: str, device: Device) -> Iterator[Worker]:
    """Start a candidate's process; it ends with the block."""
    command = [
        *(python, "-m", "experiments.bench.worker", candidate.name),
        *(f"experiments.bench.{candidate.module}", candidate.function),
        *(json.dumps(dict(candidate.options)), str(folder)),
    ]
    # Candidates share an accelerator, so no candidate may reserve all of its memory.
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
    compare: Comparison = compare_disparities,
) -> list[Timing]:
    """Time candidates on one problem by turns, so that other load affects all of them equally.

    Args:
        problem: Network and light fields.
        candidates: The candidates.
        repeats: Number of turns after a first run, which compiles.
        calls: Runs of a candidate in a turn, of which the median counts; the first of them may wake
            an accelerator up.
        device: Device of all candidates.
        peer_python: Interpreter of the peers.
        compare: Comparison of an answer with that of its reference.

    Returns:
        One timing for each candidate, in order.

    Raises:
        InputError: If a candidate's framework is not installed, or its process ends early.
        RuntimeError: If an answer differs from that of its reference.
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
                    f"pass the --peer-python that has it, or remove {candidate.name} from --peers"
                )
            workers.append(worker)
        firsts = [worker.run(1) for worker in workers]
        differences = check_answers(candidates, folder, compare)
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
                *(candidate.flops, differences[candidate.name]),
            )
        )
    return timings


def check_answers(
    candidates: Sequence[Candidate], folder: Path, compare: Comparison
) -> dict[str, dict[str, float]]:
    """Compare the first answers with those of their references.

    Returns:
        Differences by candidate and measure.

    Raises:
        RuntimeError: If a difference exceeds its bound.
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
                    f"{candidate.name} differs from {candidate.reference}: {measure} "
                    f"{measures[measure]:.1e} exceeds {bound:.0e}"
                )
    return found
