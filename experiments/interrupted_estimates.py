"""Kill ``occjax estimate`` at random moments, resume it, and compare with an uninterrupted run.

    python -m experiments.interrupted_estimates

Cost: a minute on two idle cores. Expected: after the last run every file is that of the run without
interruption, except for the times in ``summary.json``, and no temporary file is left.
"""

from __future__ import annotations

import json
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from experiments.command_line import main
from occjax.data.bundled_sample import sample
from occjax.io.atomic import TEMPORARY_NAME

MAX_SECONDS_TO_KILL = 1.5
"""Time after the first new file of a run within which it is killed, in every second run."""

MAX_SECONDS_IN_WRITING = 0.03
"""Time after the first temporary file of a run within which it is killed, in the other runs."""


def interrupt_estimates(kills: int = 10, scenes: int = 60, seed: int = 0) -> int:
    """Print what was found after each kill, and whether the final results are the same.

    Args:
        kills: Number of runs that are killed by SIGKILL.
        scenes: Number of scenes, crops of the bundled sample.
        seed: Seed of the moments.

    Returns:
        0 if the results are the same and nothing is left, else 1.
    """
    generator = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        given, whole, results = (Path(folder, name) for name in ("scenes", "whole", "results"))
        _write_scenes(given, scenes)
        _start(given, whole).wait()
        killed, writing = 0, 0
        for number in range(kills):
            before, earlier = _complete(results), _begun(results)
            process = _start(given, results)
            while (
                process.poll() is None
                and _begun(results) <= earlier
                and (number % 2 or _complete(results) == before)
            ):
                time.sleep(0.0005)
            limit = MAX_SECONDS_IN_WRITING if number % 2 else MAX_SECONDS_TO_KILL
            time.sleep(generator.uniform(0.0, limit))
            process.kill()
            if process.wait() == 0:
                break
            killed += 1
            remains, complete = len(_remains(results)), _complete(results)
            writing += remains > 0
            print(f"kill {number + 1}: {complete} of {scenes} complete, {remains} temporary")
        begin = time.perf_counter()
        code = _start(given, results).wait()
        seconds = time.perf_counter() - begin
        different = _different_files(whole, results)
        print(f"killed {killed} times, {writing} of them while files were written")
        left = len(_remains(results))
        print(f"last run: exit code {code}, {seconds:.1f} s, {left} temporary files left")
        print(f"files that differ from the uninterrupted run: {', '.join(different) or 'none'}")
    return int(bool(different or code or left))


def _write_scenes(folder: Path, count: int) -> None:
    """Write crops of the sample, 3x3 views of 24x32 pixels."""
    folder.mkdir()
    views = sample().central(3, 3).views
    for number in range(count):
        top, left = 3 * number % 200, 7 * number % 200
        np.savez(
            folder / f"scene{number:03d}.npz",
            views=views[:, :, top : top + 24, left : left + 32],
            disparity_range=np.array([-2.0, 2.0]),
        )


def _start(scenes: Path, results: Path) -> subprocess.Popen:
    """Start a run."""
    command = ["estimate", scenes, "-o", results, "--model", "photometric"]
    return subprocess.Popen(
        [sys.executable, "-m", "occjax", *command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def _complete(results: Path) -> int:
    """Return the number of complete scenes."""
    return len(list(results.glob("*/summary.json")))


def _begun(results: Path) -> set[Path]:
    """Return the temporary folders of scenes; not those that test whether a folder is writable."""
    return set(results.glob(".scene???.*"))


def _remains(results: Path) -> list[Path]:
    """Return temporary files and folders in the results."""
    places = [*results.glob(".*"), *results.glob("[!.]*/.*")]
    return [place for place in places if TEMPORARY_NAME.fullmatch(place.name)]


def _different_files(whole: Path, results: Path) -> list[str]:
    """Return the files that one of two folders lacks, or that differ in more than the times."""
    names = {
        path.relative_to(folder)
        for folder in (whole, results)
        for path in folder.rglob("*")
        if path.is_file() and path.parent != folder
    }
    return sorted(str(name) for name in names if _content(whole / name) != _content(results / name))


def _content(path: Path) -> bytes | dict | None:
    """Return what a file holds, without the times and the memory of a run."""
    if not path.is_file():
        return None
    if path.suffix != ".json":
        return path.read_bytes()
    content = json.loads(path.read_text(encoding="utf-8"))
    return {
        name: value for name, value in content.items() if name not in ("seconds", "peak_memory_mb")
    }


if __name__ == "__main__":
    main(interrupt_estimates, __doc__)
