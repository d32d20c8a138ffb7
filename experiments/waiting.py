"""Time of a command outside of the computation, by phase.

    python -m experiments.waiting SCENE
    python -m experiments.waiting SCENE --before CHECKOUT --scenes 20

Each command runs in a new process with a cache folder of its own. ``--before`` is another checkout
of occjax, such as an earlier version, which is measured in turns with this one. Prints seconds as
two Markdown tables: phases of a run, and whole commands; in the rows of ratios they are divided by
the computation (``seconds.run`` of ``summary.json`` of the same process). Expect 3 minutes for a
scene of 9x9 views of 512x512 pixels on two idle cores, and 5 minutes more for ``--scenes 20``.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated, NamedTuple

from tyro.conf import Positional, arg

from experiments.command_line import main
from experiments.markdown import markdown_table

PHASES = """
import json, sys, time
begin = time.perf_counter()
seconds = {}
def lap(name):
    global begin
    now = time.perf_counter()
    seconds[name] = now - begin
    begin = now
import occjax.cli.estimating
try:
    from occjax.estimators import make_estimator, run_estimator
    from occjax.results import outputs
except ImportError:  # before the package estimators, such as at commit 2805166
    from occjax.inference import Estimator as make_estimator, outputs
    run_estimator = lambda estimator, light_field, **_: estimator(light_field)
from occjax.io.loading import load
lap("imports")
estimator = make_estimator()
lap("weights")
light_field = load(sys.argv[1])
lap("reading, view order")
# Before there were options, the command computed the occlusion maps while it wrote.
old = not hasattr(outputs, "OutputOptions")
estimate = run_estimator(estimator, light_field, occlusion=old)
begin = time.perf_counter() - estimate.seconds.get("occlusion", 0.0)
seconds["tracing, lowering, loading"] = estimate.seconds["compile"]
seconds["run"] = estimate.seconds["run"]
outputs.write_outputs(estimate, light_field, sys.argv[2])
lap("writing")
run_estimator(estimator, light_field)  # loads the program without occlusion maps
begin = time.perf_counter()
again = run_estimator(estimator, light_field)
seconds["around a repeated estimate"] = time.perf_counter() - begin - again.seconds["run"]
print(json.dumps(seconds))
"""
"""Measures the phases of one estimate; runs with this version and with earlier ones."""


class Run(NamedTuple):
    """Seconds of a command, and of the computation in it."""

    seconds: float
    computation: float


def waiting(
    scene: Positional[Annotated[Path, arg(help="Folder of a light field.")]],
    before: Annotated[Path | None, arg(help="Another checkout to compare with.")] = None,
    repeats: Annotated[int, arg(help="Number of runs, in turns; medians are printed.")] = 3,
    scenes: Annotated[int, arg(help="Number of scenes of the run of many scenes; 0: none.")] = 0,
) -> None:
    """Measure the phases and the commands and print both tables."""
    here = Path(__file__).resolve().parents[1]
    versions = {"now": here} if before is None else {"before": before.resolve(), "now": here}
    with tempfile.TemporaryDirectory() as folder:
        measured = [
            _Version(tree, scene.resolve(), Path(folder) / name) for name, tree in versions.items()
        ]
        firsts = [version.estimate() for version in measured]
        for _ in range(repeats):
            for version in measured:
                version.measure()
        many = [version.estimate(scenes) if scenes else None for version in measured]
    names = list(versions)
    phases = [
        (phase, *(f"{version.median(phase):.2f}" for version in measured))
        for phase in measured[-1].phases[0]
    ]
    print(markdown_table(("seconds", *names), phases, right=True))
    rows = [
        _row("`occjax --help`", [v.median("help") for v in measured]),
        _row("a wrong argument of `occjax estimate`", [v.median("wrong") for v in measured]),
        _row("first `occjax estimate` of a shape", [r.seconds for r in firsts]),
        _row("without its computation", [r.seconds - r.computation for r in firsts]),
        _row("second `occjax estimate`", [v.median("second") for v in measured]),
        _row("without its computation", [v.median("outside") for v in measured]),
        _row("divided by its computation (ratio)", [v.median("ratio") for v in measured]),
    ]
    if scenes:
        # The computation of one scene alone: while others are read and written, it takes longer.
        ratios = [
            run.seconds / (scenes * version.median("alone"))
            for run, version in zip(many, measured, strict=True)
            if run is not None
        ]
        rows.append(_row(f"{scenes} scenes", [run.seconds for run in many if run is not None]))
        rows.append(_row("divided by as many computations (ratio)", ratios))
    print()
    print(markdown_table(("seconds", *names), rows, right=True))


class _Version:
    """One checkout, its cache folder, and what was measured of it."""

    def __init__(self, tree: Path, scene: Path, folder: Path) -> None:
        self.tree, self.scene, self.folder = tree, scene, folder
        self.phases: list[dict[str, float]] = []
        self.commands: list[dict[str, float]] = []
        self.environment = os.environ | {
            "XDG_CACHE_HOME": str(folder / "cache"),
            "PYTHONPATH": str(tree),
        }
        folder.mkdir()

    def measure(self) -> None:
        """Run all short commands once."""
        output = self._python("-c", PHASES, self.scene, self.folder / "phases")[1]
        seconds = json.loads(output.splitlines()[-1])
        second = self.estimate()
        self.phases.append(seconds)
        self.commands.append(
            {
                "help": self._python("-m", "occjax", "--help")[0],
                "wrong": self._python("-m", "occjax", "estimate", "--wrong")[0],
                "second": second.seconds,
                "outside": second.seconds - second.computation,
                "ratio": second.seconds / second.computation,
                "alone": second.computation,
            }
        )

    def median(self, name: str) -> float:
        """Return the median of a phase or command."""
        runs = self.phases if name in self.phases[0] else self.commands
        return statistics.median(run[name] for run in runs)

    def estimate(self, count: int = 1) -> Run:
        """Run ``occjax estimate`` on the scene, under as many names as asked for."""
        links = self.folder / f"scenes{count}"
        links.mkdir(exist_ok=True)
        for number in range(count):
            folder = links / f"scene{number}"
            if not folder.exists():
                # Copies: a scene that is listed twice is estimated once.
                folder.mkdir()
                for file in self.scene.iterdir():
                    (folder / file.name).symlink_to(file)
        output = self.folder / "results"
        shutil.rmtree(output, ignore_errors=True)  # complete scenes would be skipped
        places = sorted(links.iterdir())
        seconds, _ = self._python("-m", "occjax", "estimate", *places, "-o", output)
        summary = json.loads((output / "scene0/summary.json").read_text(encoding="utf-8"))
        return Run(seconds, summary["seconds"]["run"])

    def _python(self, *arguments: object) -> tuple[float, str]:
        begin = time.perf_counter()
        done = subprocess.run(
            [sys.executable, *map(str, arguments)],
            cwd=self.tree,
            env=self.environment,
            capture_output=True,
            text=True,
        )
        seconds = time.perf_counter() - begin
        if done.returncode != (2 if "--wrong" in arguments else 0):
            raise RuntimeError(done.stderr)
        return seconds, done.stdout


def _row(name: str, values: list[float]) -> tuple[str, ...]:
    return (name, *(f"{value:.2f}" for value in values))


if __name__ == "__main__":
    main(waiting, __doc__)
