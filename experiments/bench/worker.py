"""Process of one candidate, which runs it on request of the parent.

    python -m experiments.bench.worker NAME MODULE FUNCTION OPTIONS FOLDER

OPTIONS is a JSON object with keyword arguments of the function that builds the candidate. FOLDER
contains the files of :func:`experiments.bench.peers.description.save`. The worker prints a line of
JSON when it is ready. Each line of standard input is a number of runs; the worker answers with a
line of JSON: ``seconds`` of each run, and ``peak_memory`` in bytes so far, of the accelerator or
without one of the process. The first run compiles; its answer is stored as ``NAME.npy``. The worker
imports only the modules of its candidate.
"""

from __future__ import annotations

import importlib
import json
import resource
import sys
import time
from pathlib import Path

import numpy as np

from experiments.bench.peers.description import Program, load


def peak_memory() -> int:
    """Return the peak resident memory of this process in bytes.

    ``getrusage`` is the fallback, because its maximum includes the parent's memory at the start.
    """
    status = Path("/proc/self/status")
    if not status.exists():
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak if sys.platform == "darwin" else 1024 * peak
    (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
    return 1024 * int(line.split()[1])


def answer(**fields: object) -> None:
    """Print a line of JSON for the parent."""
    print(json.dumps(fields), flush=True)


def serve(name: str, module: str, function: str, options: dict, folder: Path) -> None:
    """Build a candidate, then run it as often as each line of standard input says."""
    try:
        build = getattr(importlib.import_module(module), function)
    except ModuleNotFoundError as missing:
        answer(missing=missing.name)
        return
    program: Program = build(load(folder), **options)
    answer(peak_memory=program.peak_memory() or peak_memory())
    kept = folder / f"{name}.npy"
    for line in sys.stdin:
        seconds = []
        for _ in range(int(line)):
            begin = time.perf_counter()
            result = program.run()
            seconds.append(time.perf_counter() - begin)
            if not kept.exists():
                np.save(kept, program.fetch(result))
        answer(seconds=seconds, peak_memory=program.peak_memory() or peak_memory())


if __name__ == "__main__":
    name, module, function, options, folder = sys.argv[1:]
    serve(name, module, function, json.loads(options), Path(folder))
