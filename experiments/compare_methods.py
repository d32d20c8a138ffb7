"""Methods compared on a scene: a table of all measures, a radar chart, and pairs pixel by pixel.

    python -m experiments.compare_methods SCENE NAME=ESTIMATE NAME=ESTIMATE -o FOLDER

SCENE is a folder of the HCI 4D benchmark with ground truth and masks, ESTIMATE a disparity map or a
folder that ``occjax estimate`` wrote.

Cost: seconds. Expected: ``scores.md``, which is printed too, ``radar.png``, and for every pair
``A_against_B.png``. The measures are those that the scene has masks for
(:mod:`occjax.evaluation.benchmark`).
"""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Annotated

import tyro

from experiments.command_line import main
from experiments.markdown import markdown_table
from occjax.errors import InputError
from occjax.evaluation import BORDER, SceneScores, evaluate_scene, read_disparity
from occjax.io import atomic_path, read_pfm
from occjax.viz import pairwise_figure, radar_figure, save


def named(estimates: tuple[str, ...]) -> dict[str, Path]:
    """Paths by the names given to them on the command line."""
    paths = {}
    for estimate in estimates:
        name, equals, path = estimate.partition("=")
        if not (name and equals and path) or "/" in name:
            raise InputError(f"{estimate}: is not NAME=ESTIMATE, with a name that fits a file's")
        if name in paths:
            raise InputError(f"{name}: is the name of two estimates; give each its own")
        paths[name] = Path(path)
    return paths


def table(scores: dict[str, SceneScores]) -> str:
    """Measures as a Markdown table, one method a column."""
    names = dict.fromkeys(name for one in scores.values() for name in one.values)
    rows = [
        [name, *(f"{s.values[name]:.3f}" if name in s.values else "-" for s in scores.values())]
        for name in names
    ]
    return markdown_table(["measure", *scores], rows)


def run(
    scene: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(help="Folder of the scene.")]],
    estimates: tyro.conf.Positional[
        Annotated[tuple[str, ...], tyro.conf.arg(help="NAME=ESTIMATE, at least one.")]
    ],
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="FOLDER", help="Folder of the results.")
    ],
    border: Annotated[int, tyro.conf.arg(help="Pixels left out at each side.")] = BORDER,
) -> dict[str, SceneScores]:
    """Write the table and the pictures, print the table, and return the scores by method."""
    paths = named(estimates)
    scores = {name: evaluate_scene(scene, path, border=border) for name, path in paths.items()}
    with atomic_path(output / "scores.md") as temporary:
        temporary.write_text(table(scores) + "\n", encoding="utf-8")
    title = f"{scene.resolve().name}: inside is better, the numbers are those of the rim"
    save(radar_figure({n: s.values for n, s in scores.items()}, title=title), output / "radar.png")
    truth = read_pfm(scene / "gt_disp_lowres.pfm")
    maps = {name: read_disparity(path) for name, path in paths.items()}
    for first, second in combinations(maps, 2):
        figure = pairwise_figure(
            maps[first], maps[second], truth, names=(first, second), border=border
        )
        save(figure, output / f"{first}_against_{second}.png")
    print(table(scores))
    return scores


if __name__ == "__main__":
    main(run, __doc__)
