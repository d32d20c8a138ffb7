"""One candidate in a process of its own, which runs it whenever its parent asks.

    python -m experiments.bench.worker NAME FOLDER

FOLDER holds what :func:`experiments.bench.peers.description.save` writes. The worker answers every
line on its standard input with a line of JSON, after one when it is ready: ``seconds`` of a run and
the process's ``peak_memory`` in bytes so far. The first run compiles; its disparity is kept as
``NAME.npy``. It imports only what its candidate needs.
"""

from __future__ import annotations

import importlib
import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from experiments.bench.peers.description import load

BUILDERS = {
    "occjax": ("experiments.bench.ours", "build"),
    "written": ("experiments.bench.ours", "build_written"),
    "matrix product": ("experiments.bench.matrix_product", "build"),
    "torch": ("experiments.bench.peers.in_torch", "build"),
    "tensorflow": ("experiments.bench.peers.in_tensorflow", "build"),
}
"""Module and function that build each candidate."""


def peak_memory() -> int:
    """Largest resident memory of this process in bytes.

    The maximum that ``getrusage`` knows includes the parent's before the process was started.
    """
    status = Path("/proc/self/status")
    if not status.exists():
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak if sys.platform == "darwin" else 1024 * peak
    (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
    return 1024 * int(line.split()[1])


def answer(**fields: object) -> None:
    """A line to the parent."""
    print(json.dumps(fields), flush=True)


def serve(name: str, folder: Path) -> None:
    """Build a candidate, then run it once for every line of standard input."""
    network, variables, views = load(folder)
    module, function = BUILDERS[name]
    try:
        build = getattr(importlib.import_module(module), function)
    except ModuleNotFoundError as missing:
        answer(missing=missing.name)
        return
    run: Callable[[np.ndarray], np.ndarray] = build(network, variables)
    answer(peak_memory=peak_memory())
    kept = folder / f"{name}.npy"
    for _ in sys.stdin:
        begin = time.perf_counter()
        disparity = run(views)
        seconds = time.perf_counter() - begin
        if not kept.exists():
            np.save(kept, disparity)
        answer(seconds=seconds, peak_memory=peak_memory())


if __name__ == "__main__":
    serve(sys.argv[1], Path(sys.argv[2]))
