"""Comparison of methods on a scene: a table of all measures, a radar chart, and pairs of maps.

    python -m experiments.compare_methods SCENE NAME=ESTIMATE NAME=ESTIMATE -o FOLDER
    python -m experiments.compare_methods -o FOLDER --small

SCENE is a folder of the HCI 4D benchmark with ground truth and masks; ESTIMATE is a disparity map
or a result folder of ``occjax estimate``.

Cost: seconds. Expected: ``scores.md``, which is also printed, ``radar.png``, and for every pair
``A_against_B.png``. The measures are those for which the scene has masks
(:mod:`occjax.evaluation.benchmark`). ``--small`` compares maps with known scores: the ground truth
of the bundled sample plus 0.02, and the ground truth plus 0.1 in its left half.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from experiments.command_line import Small, announce_smoke_test, main
from experiments.markdown import markdown_table, write_text
from experiments.method_figures import pairwise_figure, radar_figure
from occjax.cli.options import option
from occjax.data.bundled_sample import sample
from occjax.errors import InputError
from occjax.evaluation import BORDER, SceneScores, evaluate_scene, read_disparity
from occjax.io import read_pfm, write_pfm
from occjax.io.hci_config import GROUND_TRUTH
from occjax.viz import save


def parse_named(estimates: tuple[str, ...]) -> dict[str, Path]:
    """Return the paths of ``NAME=ESTIMATE`` arguments by name.

    Raises:
        InputError: If an argument has no name that is valid in a file name, or a name is repeated.
    """
    paths = {}
    for estimate in estimates:
        name, equals, path = estimate.partition("=")
        if not (name and equals and path) or "/" in name:
            raise InputError(f"{estimate}: is not NAME=ESTIMATE with a name valid in a file name")
        if name in paths:
            raise InputError(f"{name}: is the name of two estimates; choose different names")
        paths[name] = Path(path)
    return paths


def table(scores: Mapping[str, SceneScores]) -> str:
    """Return the measures as a Markdown table with one column for each method."""
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
        Annotated[tuple[str, ...], option("One or more estimates.", "NAME=ESTIMATE")]
    ] = (),
    *,
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], metavar="FOLDER", help="Folder of the results.")
    ],
    border: Annotated[int, tyro.conf.arg(help="Border to leave out, in pixels.")] = BORDER,
    small: Small = False,
) -> dict[str, SceneScores]:
    """Write the table and the figures, print the table, and return the scores by method."""
    if small:
        if scene is not None:
            raise InputError("--small has its own maps; remove the scene and the estimates")
        announce_smoke_test()
        with tempfile.TemporaryDirectory() as folder:
            return compare(*write_known(Path(folder)), output, border=border)
    if scene is None or not estimates:
        raise InputError("name a scene and one or more NAME=ESTIMATE, or pass --small alone")
    return compare(scene, parse_named(estimates), output, border=border)


def compare(
    scene: Path, paths: Mapping[str, Path], output: Path, *, border: int
) -> dict[str, SceneScores]:
    """Write the table and the figures, and print the table.

    Args:
        scene: Folder with ground truth and optional masks.
        paths: Estimates by the name of the method.
        output: Folder of the results.
        border: Border to leave out at each side, in pixels.

    Returns:
        Scores by method.

    Raises:
        InputError: If a file is missing or unusable.
    """
    scores = {name: evaluate_scene(scene, path, border=border) for name, path in paths.items()}
    write_text(output / "scores.md", table(scores))
    title = f"{scene.resolve().name}: smaller is better; numbers are the values at the rim"
    save(radar_figure({n: s.values for n, s in scores.items()}, title=title), output / "radar.png")
    written = ["scores.md", "radar.png"]
    truth = read_pfm(scene / GROUND_TRUTH)
    maps = {name: read_disparity(path) for name, path in paths.items()}
    for pair in combinations(maps, 2):
        figure = pairwise_figure(*(maps[name] for name in pair), truth, names=pair, border=border)
        written.append(f"{pair[0]}_against_{pair[1]}.png")
        save(figure, output / written[-1])
    print(table(scores))
    print(f"\n{', '.join(written)} written to {output}")
    return scores


def known_maps(truth: np.ndarray) -> dict[str, np.ndarray]:
    """Return two estimates with known scores.

    For any border, ``moved`` has MSE x100 0.04, BadPix 0, 0 and 100 % and Q25 x100 2; ``half`` has
    MSE x100 0.5, BadPix 50 % for all thresholds and Q25 x100 0.

    Args:
        truth: ``[H, W]`` true disparity, pixels per view step; W is even.

    Returns:
        ``[H, W]`` maps by name: the truth plus 0.02, and the truth plus 0.1 in its left half.
    """
    half = truth.copy()
    half[:, : truth.shape[1] // 2] += np.float32(0.1)
    return {"moved": truth + np.float32(0.02), "half": half}


def write_known(folder: Path) -> tuple[Path, dict[str, Path]]:
    """Write the bundled sample as a scene, and :func:`known_maps` of it.

    Returns:
        Folder of the scene, and the estimates by name.
    """
    truth = sample().ground_truth
    assert truth is not None
    write_pfm(folder / "sample" / GROUND_TRUTH, truth)
    paths = {}
    for name, disparity in known_maps(truth).items():
        paths[name] = folder / f"{name}.pfm"
        write_pfm(paths[name], disparity)
    return folder / "sample", paths


if __name__ == "__main__":
    main(run, __doc__)
