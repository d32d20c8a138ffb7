"""Long form of the fuzzing: ``python -m tests.fuzz --cases 20000`` prints a table in Markdown.

Each reader runs in a process of its own, whose peak memory is measured. A case that takes longer
than 5 seconds, an exception other than InputError, and the end of the process count as failures.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from tests.fuzz.edits import apply, random_edits
from tests.fuzz.readers import READERS, outcome

MAX_SECONDS = 5.0
MAX_BYTES = 2**30


def main():
    """Fuzz all readers, or one; return 1 if one failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=20_000, help="damaged files per reader")
    parser.add_argument("--reader", type=int, help="number of one reader, whose result is JSON")
    arguments = parser.parse_args()
    if arguments.reader is not None:
        print(json.dumps(fuzz(READERS[arguments.reader], arguments.cases)))
        return 0
    print("| reader | cases | accepted | refused | foreign | slowest, s | added memory, MB |")
    print("|---|---:|---:|---:|---:|---:|---:|")
    failed = False
    for number, reader in enumerate(READERS):
        command = [sys.executable, "-m", "tests.fuzz", "--reader", str(number)]
        command += ["--cases", str(arguments.cases)]
        child = subprocess.run(command, capture_output=True, text=True, errors="replace")
        if child.returncode:
            failed = True
            print(f"| {reader.name} | ended with code {child.returncode} | | | | | |", flush=True)
            continue
        result = json.loads(child.stdout.splitlines()[-1])
        foreign = sum(result["foreign"].values())
        failed |= bool(foreign or result["seconds"] > MAX_SECONDS or result["bytes"] > MAX_BYTES)
        print(
            f"| {reader.name} | {arguments.cases} | {result['accepted']} | {result['refused']} "
            f"| {foreign} | {result['seconds']:.2f} | {result['bytes'] / 1e6:.0f} |",
            flush=True,
        )
        for error, count in result["foreign"].items():
            print(f"{reader.name}: {count} times {error}", file=sys.stderr, flush=True)
    return int(failed)


def fuzz(reader, cases):
    """Return the number of each outcome, the longest time, and the growth of the peak memory."""
    counts, slowest = Counter(), 0.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        reader.folder(folder)
        for valid in reader.seeds:
            outcome(reader, folder, valid)
        before = peak_bytes()
        for case in range(cases):
            data = apply(reader.seeds[case % len(reader.seeds)], random_edits(case))
            begin = time.process_time()
            counts[outcome(reader, folder, data)[:200]] += 1
            slowest = max(slowest, time.process_time() - begin)
    accepted, refused = counts.pop("accepted", 0), counts.pop("refused", 0)
    return {
        "accepted": accepted,
        "refused": refused,
        "foreign": dict(counts),
        "seconds": slowest,
        "bytes": peak_bytes() - before,
    }


def peak_bytes():
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


if __name__ == "__main__":
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    sys.exit(main())
