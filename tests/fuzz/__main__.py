"""Long form of the fuzzing: ``python -m tests.fuzz --cases 20000`` prints a table in Markdown.

Each reader runs in a process of its own, whose peak memory is measured. A case that takes more than
5 seconds of CPU time, an exception other than InputError, growth of the memory by more than 1 GB,
and the death of the process are failures.
"""

import argparse
import os
import resource
import signal
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path

from tests.fuzz.edits import apply, random_edits
from tests.fuzz.readers import READERS, outcome

MAX_SECONDS = 5.0
MAX_BYTES = 2**30


def main():
    """Fuzz all readers and print a table; return 1 if one failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=20_000, help="damaged files per reader")
    cases = parser.parse_args().cases
    print("| reader | cases | accepted | refused | foreign | slowest, s | added memory, MB |")
    print("|---|---:|---:|---:|---:|---:|---:|", flush=True)
    failed = False
    for number, reader in enumerate(READERS):
        try:
            with ProcessPoolExecutor(1, mp_context=get_context("fork")) as pool:
                counts, seconds, memory = pool.submit(fuzz, number, cases).result()
        except BrokenProcessPool:
            counts, seconds, memory = {"the process died": 1}, 0.0, 0
        accepted, refused = counts.pop("accepted", 0), counts.pop("refused", 0)
        print(
            f"| {reader.name} | {cases} | {accepted} | {refused} | {sum(counts.values())} "
            f"| {seconds:.2f} | {memory / 1e6:.0f} |",
            flush=True,
        )
        for error, count in counts.items():
            print(f"{reader.name}: {count} times {error}", file=sys.stderr)
        failed |= bool(counts) or seconds > MAX_SECONDS or memory > MAX_BYTES
    return int(failed)


def fuzz(number, cases):
    """Return the number of each outcome, the longest time, and the growth of the peak memory."""
    reader, counts, slowest = READERS[number], Counter(), 0.0
    for stream in (1, 2):  # on which decoders report
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        reader.folder(folder)
        for valid in reader.seeds:
            outcome(reader, folder, valid)
        before = peak_bytes()
        for case in range(cases):
            data = apply(reader.seeds[case % len(reader.seeds)], random_edits(case))
            # The end of the timer ends the process, also in compiled code that does not return.
            signal.setitimer(signal.ITIMER_VIRTUAL, 6 * MAX_SECONDS)
            begin = time.process_time()
            counts[outcome(reader, folder, data)[:200]] += 1
            slowest = max(slowest, time.process_time() - begin)
    return counts, slowest, peak_bytes() - before


def peak_bytes():
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    sys.exit(main())
