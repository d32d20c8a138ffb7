"""What the small form of every script prints and draws, for ``experiments/small``.

    python -m experiments.small_forms                       (all, one after the other)
    python -m experiments.small_forms ablation figures

Cost: about half an hour on two cores, no download; most scripts take half a minute, but those that
train every row longer: ``ablation`` a quarter of an hour, ``light_ablation`` ten minutes. Expected:
every script ends well. Networks of few channels that were trained for two steps show that the
scripts run, nothing about a method.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated

from PIL import Image
from tyro.conf import Positional, arg

from experiments.command_line import main
from occjax.errors import InputError

HERE = Path(__file__).parent

FORMS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "ablation": ("FOLDER",),
        "benchmark_table": ("-o", "FOLDER"),
        "compare_methods": ("-o", "FOLDER"),
        "efficiency_table": (),
        "figures": ("-o", "FOLDER", "--without", "photometric"),
        "interval_study": ("FOLDER", "--time"),
        "light_ablation": ("FOLDER",),
        "operations": (),
        "photometric_robustness": (),
        "real_scenes": ("-o", "FOLDER/sheet.png"),
        "submit": ("make", "-o", "FOLDER/trial.zip"),
        "train_hci": ("-o", "FOLDER"),
        "validation_scores": (),
    }
)
"""Arguments of each script beside ``--small``; FOLDER is one for what it writes."""

LARGEST = 120_000
"""Bytes beyond which a picture is kept as WebP, whose losses do not matter to look at it."""


def run(
    names: Positional[
        Annotated[tuple[str, ...], arg(metavar="NAME...", help="Which scripts; all by default.")]
    ] = (),
    output: Annotated[
        Path, arg(aliases=["-o"], metavar="FOLDER", help="Folder of the results.")
    ] = HERE / "small",
) -> int:
    """Run small forms; exit code 1 if one fails."""
    for name in names:
        if name not in FORMS:
            raise InputError(f"there is no script named {name!r}; there are {', '.join(FORMS)}")
    failed = 0
    for name in names or FORMS:
        with tempfile.TemporaryDirectory() as folder:
            made = Path(folder) / "FOLDER"
            made.mkdir()
            done = subprocess.run(
                [
                    *(sys.executable, "-m", f"experiments.{name}"),
                    *(argument.replace("FOLDER", str(made)) for argument in FORMS[name]),
                    "--small",
                ],
                cwd=HERE.parent,
                capture_output=True,
                text=True,
                check=False,
            )
            if done.returncode:
                print(f"{name} failed:\n{done.stderr}")
                failed = 1
                continue
            print(name)
            place = output / name
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir(parents=True)
            printed = done.stdout.replace(str(made), "FOLDER")
            for picture in sorted(made.glob("*.png")):
                if picture.stat().st_size <= LARGEST:
                    shutil.copy(picture, place)
                else:
                    with Image.open(picture) as image:
                        image.convert("RGB").save(place / f"{picture.stem}.webp", method=6)
                    printed = printed.replace(picture.name, f"{picture.stem}.webp")
            (place / "printed.md").write_text(printed)
    return failed


if __name__ == "__main__":
    main(run, __doc__)
