"""Methods compared on a scene: a table of all measures, a radar chart, and pairs pixel by pixel.

    python -m experiments.compare_methods SCENE NAME=ESTIMATE NAME=ESTIMATE -o FOLDER
    python -m experiments.compare_methods -o FOLDER --small           (a check of the script itself)

SCENE is a folder of the HCI 4D benchmark with ground truth and masks, ESTIMATE a disparity map or a
folder that ``occjax estimate`` wrote.

Cost: seconds. Expected: ``scores.md``, which is printed too, ``radar.png``, and for every pair
``A_against_B.png``. The measures are those that the scene has masks for
(:mod:`occjax.evaluation.benchmark`).

``--small`` compares maps whose scores are known: the bundled sample's ground truth moved by 0.02,
and moved by 0.1 in its left half alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from experiments.command_line import main
from experiments.markdown import markdown_table
from occjax.cli.options import option
from occjax.data.sample import sample
from occjax.data.scenes import GROUND_TRUTH
from occjax.errors import InputError
from occjax.evaluation import BORDER, SceneScores, evaluate_scene, read_disparity
from occjax.io import atomic_path, read_pfm, write_pfm
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
    scene: tyro.conf.Positional[
        Annotated[Path | None, option("Folder of the scene.", "SCENE")]
    ] = None,
    estimates: tyro.conf.Positional[
        Annotated[tuple[str, ...], option("One or more.", "NAME=ESTIMATE")]
    ] = (),
    *,
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="FOLDER", help="Folder of the results.")
    ],
    border: Annotated[int, tyro.conf.arg(help="Pixels left out at each side.")] = BORDER,
    small: Annotated[bool, tyro.conf.arg(help="Compare maps whose scores are known.")] = False,
) -> dict[str, SceneScores]:
    """Write the table and the pictures, print the table, and return the scores by method."""
    if small:
        if scene is not None:
            raise InputError("--small makes its own maps; leave out the scene and the estimates")
        with tempfile.TemporaryDirectory() as folder:
            return compare(*write_known(Path(folder)), output, border=border)
    if scene is None or not estimates:
        raise InputError("name a scene and one NAME=ESTIMATE or more, or try with --small")
    return compare(scene, named(estimates), output, border=border)


def compare(
    scene: Path, paths: Mapping[str, Path], output: Path, *, border: int
) -> dict[str, SceneScores]:
    """Write the table and the pictures, print the table and what was written.

    Args:
        scene: Folder with ground truth, and maybe masks.
        paths: Estimates by the name of the method.
        output: Folder of the results.
        border: Pixels left out at each side.

    Returns:
        Scores by method.

    Raises:
        InputError: If a file is missing or cannot be used.
    """
    scores = {name: evaluate_scene(scene, path, border=border) for name, path in paths.items()}
    with atomic_path(output / "scores.md") as temporary:
        temporary.write_text(table(scores) + "\n", encoding="utf-8")
    title = f"{scene.resolve().name}: inside is better, the numbers are those of the rim"
    save(radar_figure({n: s.values for n, s in scores.items()}, title=title), output / "radar.png")
    written = ["scores.md", "radar.png"]
    truth = read_pfm(scene / GROUND_TRUTH)
    maps = {name: read_disparity(path) for name, path in paths.items()}
    for first, second in combinations(maps, 2):
        figure = pairwise_figure(
            maps[first], maps[second], truth, names=(first, second), border=border
        )
        written.append(f"{first}_against_{second}.png")
        save(figure, output / written[-1])
    print(table(scores))
    print(f"\n{', '.join(written)} written to {output}")
    return scores


def known_maps(truth: np.ndarray) -> dict[str, np.ndarray]:
    """Two estimates whose scores are known, by name.

    Inside any border, ``moved`` has MSE x100 0.04, BadPix 0, 0 and 100 % and Q25 x100 2; ``half``
    has MSE x100 0.5, BadPix 50 % thrice and Q25 x100 0.

    Args:
        truth: ``[H, W]`` true disparity, pixels per view step; W is even.

    Returns:
        ``[H, W]`` each: the truth moved by 0.02, and moved by 0.1 in its left half.
    """
    half = truth.copy()
    half[:, : truth.shape[1] // 2] += np.float32(0.1)
    return {"moved": truth + np.float32(0.02), "half": half}


def write_known(folder: Path) -> tuple[Path, dict[str, Path]]:
    """The bundled sample as a scene, and :func:`known_maps` of it.

    Args:
        folder: For the files.

    Returns:
        Folder of the scene, and the estimates by name.
    """
    truth = sample().ground_truth
    assert truth is not None
    maps = known_maps(truth)
    write_pfm(folder / "sample" / GROUND_TRUTH, truth)
    paths = {name: folder / f"{name}.pfm" for name in maps}
    for name, path in paths.items():
        write_pfm(path, maps[name])
    return folder / "sample", paths


if __name__ == "__main__":
    main(run, __doc__)
