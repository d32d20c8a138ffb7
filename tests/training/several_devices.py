"""One training on one device, on several and in several processes: the same result?

    python -m tests.training.several_devices

trains the smallest networks for 20 steps in each arrangement, compares losses and weights with
those of one device, and resumes the checkpoint of each arrangement with the others.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from itertools import permutations
from pathlib import Path
from typing import NamedTuple

import numpy as np

BATCH_SIZE = 8
RATE = 1e-4
"""Learning rate: Adam moves each weight by about as much in a step."""


class Arrangement(NamedTuple):
    """Devices and options of one training.

    Attributes:
        devices: Devices of each process.
        processes: Number of processes, connected over the loopback interface by Gloo.
        options: Options of the worker.
    """

    devices: int = 1
    processes: int = 1
    options: tuple[str, ...] = ()


ARRANGEMENTS = {
    "1 device": Arrangement(),
    "8 devices": Arrangement(devices=8),
    "8 devices, sharded state": Arrangement(devices=8, options=("--shard-state",)),
    "2 processes": Arrangement(processes=2),
    "2 processes x 4 devices": Arrangement(devices=4, processes=2),
    "2 processes x 4 devices, sharded state": Arrangement(4, 2, ("--shard-state",)),
}


class Run(NamedTuple):
    """Result of one training.

    Attributes:
        losses: Loss of each step.
        weights: All parameters, one after the other.
        made: For each process, numbers of the samples that it made.
    """

    losses: np.ndarray
    weights: np.ndarray
    made: list[list[int]]


def train_in(arrangement: Arrangement, folder: Path, steps: int, *options: str) -> Run:
    """Train, or resume, in other processes.

    Args:
        arrangement: The devices.
        folder: Training folder.
        steps: Number of steps, with those that are done.
        options: More options of the worker.
    """
    with socket.socket() as free:
        free.bind(("localhost", 0))
        coordinator = f"localhost:{free.getsockname()[1]}"
    flags = (
        f"--xla_force_host_platform_device_count={arrangement.devices}"
        " --xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"
    )
    environment = {
        "JAX_COMPILATION_CACHE_DIR": str(folder.parent / "programs"),
        **os.environ,
        "XLA_FLAGS": flags,
        "JAX_PLATFORMS": "cpu",
    }
    command = [sys.executable, "-m", __spec__.name if __spec__ else __name__, "--worker"]
    command += [str(folder), "--steps", str(steps), *arrangement.options, *options]
    workers = []
    for process in range(arrangement.processes):
        joined = ["--coordinator", coordinator, "--processes", str(arrangement.processes)]
        joined += ["--process", str(process)]
        arguments = command + (joined if arrangement.processes > 1 else [])
        workers.append(
            subprocess.Popen(
                arguments, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
            )
        )
    outputs = [worker.communicate()[0].decode() for worker in workers]
    ends = "\n\n".join(f"process {n}: {output[-9000:]}" for n, output in enumerate(outputs))
    assert not any(worker.returncode for worker in workers), ends
    made = [json.loads((folder.parent / f"made-{n}.json").read_text()) for n in range(len(workers))]
    with np.load(folder.with_suffix(".npz")) as result:
        return Run(result["losses"], result["weights"], made)


def work(arguments: Sequence[str] | None = None, devices: int | None = None) -> None:
    """Train in this process.

    Args:
        arguments: Arguments of the command; by default those of this process.
        devices: Number of devices; by default all.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument("--worker", type=Path)
    parser.add_argument("--steps", type=int)
    parser.add_argument("--checkpoint-steps", type=int, default=10)
    parser.add_argument("--accumulate", type=int, default=1)
    parser.add_argument("--network", default="occcasnet")
    parser.add_argument("--shard-state", action="store_true")
    for name, kind in (("coordinator", str), ("processes", int), ("process", int)):
        parser.add_argument(f"--{name}", type=kind)
    given = parser.parse_args(arguments)
    if given.processes:  # a process that hangs says where
        faulthandler.dump_traceback_later(240)

    from occjax.training.hosts import HostConfig, join_processes

    join_processes(HostConfig(False, given.coordinator, given.processes, given.process))

    import jax

    from occjax.data.sources import sample_numbers
    from occjax.models import save_weights
    from occjax.training import LossConfig, OptimiserConfig, RunConfig, TrainConfig, read_log, train
    from occjax.training.placement import gather
    from tests.reference.variables import random_variables
    from tests.training.conftest import NETWORK, PROPOSAL_NETWORK, planes, prepared_batch

    made = []
    proposal = given.network == "proposal"

    def source(step, rows=slice(None)):
        numbers = sample_numbers(step, rows, BATCH_SIZE)
        made.extend(numbers)
        # The search is discrete: other last digits would change the proposals, so they are stored.
        samples = [
            prepared_batch(1, (32, 32), seed=number) if proposal else planes(number, count=1)
            for number in numbers
        ]
        # Pixels without truth: every sample has another weight in the mean.
        samples = [
            sample._replace(valid=sample.valid.at[:, : number % 7].set(False))
            for number, sample in zip(numbers, samples, strict=True)
        ]
        return jax.tree.map(lambda *fields: np.concatenate(fields), *samples)

    config = TrainConfig(
        PROPOSAL_NETWORK if proposal else NETWORK,
        LossConfig(settled=0.2, distribution=0.1),
        OptimiserConfig(peak_rate=RATE, schedule="constant", clip=1.0),
        steps=given.steps,
        accumulate=given.accumulate,
    )
    run = RunConfig(
        log_every=1,
        checkpoint_steps=given.checkpoint_steps,
        devices=devices,
        shard_state=given.shard_state,
        prefetch=1,
    )
    weights = given.worker.parent / f"{given.network}.safetensors"
    if not weights.exists():  # random ones take longer to compile than to train
        save_weights(weights, random_variables(config.network), config.network)
    trained = train(
        config,
        source,
        given.worker,
        run=run,
        batch_size=BATCH_SIZE,
        initial_weights=weights,
        say=lambda line: None,
    )
    leaves = jax.tree.leaves(gather(trained.state.params))
    if jax.process_index() == 0:
        np.savez(
            given.worker.with_suffix(".npz"),
            losses=[entry["loss"] for entry in read_log(given.worker)],
            weights=np.concatenate([leaf.ravel() for leaf in leaves]),
        )
    numbers = given.worker.parent / f"made-{jax.process_index()}.json"
    numbers.write_text(json.dumps(made))


def difference(one: Run, other: Run) -> tuple[float, float]:
    """Return the largest relative difference of a loss, and the largest of a weight."""
    losses = np.abs(one.losses / other.losses - 1.0).max()
    return float(losses), float(np.abs(one.weights - other.weights).max())


def report() -> None:
    """Print the differences of every arrangement and of every resumption."""
    print("| network | arrangement | largest relative difference of a loss | of a weight |")
    print("|---|---|---:|---:|")
    with tempfile.TemporaryDirectory() as temporary:
        root = Path(temporary)
        for network in ("occcasnet", "proposal"):
            option = ("--network", network)
            one = train_in(ARRANGEMENTS["1 device"], root / f"{network}-one", 20, *option)
            more = dict(ARRANGEMENTS)
            del more["1 device"]
            if network == "proposal":  # without statistics of a batch
                more = {name: more[name] for name in ("8 devices", "2 processes")}
                more["2 devices, 4 micro-batches"] = Arrangement(2, 1, ("--accumulate", "4"))
            for name, arrangement in more.items():
                run = train_in(arrangement, root / f"{network}-{name}", 20, *option)
                print_row(network, name, run, one)
            if network == "occcasnet":
                three = ("1 device", "8 devices", "2 processes")
                for before, after in permutations(three, 2):
                    finished = root / f"{network}-{'one' if before == '1 device' else before}"
                    folder = half_of(finished, root / f"{before}-{after}")
                    run = train_in(ARRANGEMENTS[after], folder, 20)
                    print_row(network, f"10 steps: {before}; then 10: {after}", run, one)


def half_of(finished: Path, folder: Path, last: int = 20) -> Path:
    """Copy the folder of a training as it was at its checkpoint before the last one."""
    shutil.copytree(finished, folder)
    shutil.rmtree(folder / "checkpoints" / str(last))
    return folder


def print_row(network: str, name: str, run: Run, one: Run) -> None:
    """Print a row of the table."""
    losses, weights = difference(run, one)
    print(f"| {network} | {name} | {losses:.1e} | {weights:.1e} |", flush=True)


if __name__ == "__main__":
    if "--worker" in sys.argv:
        work()
    else:
        report()
