"""Contact sheet of several estimators on scenes from real cameras.

    python -m experiments.real_scenes SCENE... -o sheet.png
    python -m experiments.real_scenes SCENE... -o sheet.png --estimators proposal photometric FILE
    python -m experiments.real_scenes -o sheet.png --small         (a minute)

SCENE is any input of ``occjax estimate``: a folder of views from a Lytro camera or the Stanford
gantry, an image of all views, an array. An estimator is the name of a model or a file of weights.
For each scene the sheet shows the centre view, the disparities of all estimators in common colours,
their confidences, and their run times without compilation.

Cost: less than a minute on two cores for ``photometric`` and ``proposal`` on 9x9 views of 383x552
pixels; the paper's network needs a GPU. Expected: the scenes have no ground truth, so the sheet is
for inspection. The paper's figure shows Dinosaur, Stanford Bunny, Truck and Knights, where its
network keeps backgrounds clean and thin objects separate; that figure has not been made with this
library yet.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import Annotated

import jax
import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from tqdm import tqdm
from tyro.conf import OmitArgPrefixes, Positional, arg

from experiments.command_line import Small, announce_smoke_test, main
from experiments.cut_outs import small_sample
from experiments.figure_panels import (
    LETTER_WIDTH,
    Bar,
    Panel,
    coloured,
    panel_figure,
    rgb,
    shrink_step,
)
from occjax.cli.options import ViewOrderOptions, option
from occjax.errors import InputError
from occjax.estimators import Estimator, make_estimator, run_estimator
from occjax.io.atomic import check_writable
from occjax.lightfield import LightField, to_unit_float
from occjax.models import ALIASES, PRESETS
from occjax.viz.canvas import TEXT, save, whole_zoom
from occjax.viz.colour import (
    colourbar_extend,
    common_norm,
    confidence_colours,
    disparity_colours,
    disparity_norm,
)

PANEL_SIZE_PX = 320
"""Size that small views are enlarged to."""


@dataclass(frozen=True)
class Outcome:
    """Result of one estimator on a scene.

    Attributes:
        label: Name of the estimator.
        disparity: ``[H, W]`` pixels per view step; None if the estimator failed.
        confidence: ``[H, W]`` in [0, 1]; None if the estimator failed.
        seconds: Run time without compilation.
        failure: Error message if the estimator failed.
    """

    label: str
    disparity: np.ndarray | None = None
    confidence: np.ndarray | None = None
    seconds: float = 0.0
    failure: str = ""


@dataclass(frozen=True)
class Band:
    """One scene on the sheet.

    Attributes:
        title: Name and size of the scene.
        centre: ``[H, W, C]`` centre view as stored.
        outcomes: Results of all estimators.
    """

    title: str
    centre: np.ndarray
    outcomes: tuple[Outcome, ...]


def run(
    output: Annotated[Path, arg(aliases=["-o"], metavar="FILE.png", help="The contact sheet.")],
    scenes: Positional[
        Annotated[tuple[Path, ...], option("Folders of views, images or arrays.", "SCENE")]
    ] = (),
    estimators: Annotated[
        tuple[str, ...], arg(metavar="ESTIMATOR...", help="Names of models, or files of weights.")
    ] = ("proposal", "photometric"),
    disparity_range: Annotated[
        tuple[float, float] | None, option("Range of disparities to search.", "MIN MAX")
    ] = None,
    stored: OmitArgPrefixes[ViewOrderOptions] = ViewOrderOptions(),
    small: Small = False,
) -> int:
    """Run every estimator on every scene and write the sheet; exit code 1 if one fails."""
    if output.suffix.lower() != ".png":
        raise InputError(f"{output}: the sheet is a PNG; choose a name that ends with .png")
    if bool(scenes) == small:
        raise InputError("name one or more scenes, or pass --small alone for a smoke test")
    if not estimators:
        raise InputError(f"name an estimator: one of {', '.join(PRESETS)}, or a file of weights")
    made = {name: named_estimator(name) for name in estimators}
    check_writable(output.parent)
    if small:
        announce_smoke_test()
    bands, failed = [], False
    for scene in tqdm(scenes or (None,), unit="scene", disable=None):
        try:
            light_field = small_sample() if scene is None else stored.load(scene)
        except InputError as error:
            if len(scenes) == 1:
                raise
            failed = True
            tqdm.write(f"occjax: {error}", file=sys.stderr)
            continue
        bands.append(_band(light_field, made, disparity_range))
        failed |= any(outcome.failure for outcome in bands[-1].outcomes)
    if all(outcome.failure for band in bands for outcome in band.outcomes):
        raise InputError("all estimates failed; no sheet is written")
    device = jax.devices()[0].device_kind
    note = f"Disparity in pixels per view step. Seconds on {device}, without compilation."
    save(sheet(bands, note), output)
    print(f"written to {output}")
    return 1 if failed else 0


def named_estimator(name: str) -> Estimator:
    """Return the estimator of a model's name or a file of weights.

    Raises:
        InputError: If there is no such model or file, or the model needs weights.
    """
    is_model = name in PRESETS or name in ALIASES
    return make_estimator(name) if is_model else make_estimator(weights=name)


def sheet(bands: Sequence[Band], note: str) -> Figure:
    """Draw the contact sheet: for each scene a row of disparities above a row of confidences.

    Args:
        bands: The scenes.
        note: Line at the bottom.
    """
    return panel_figure([row for band in bands for row in _rows(band)], note)


def _rows(band: Band) -> tuple[list[Panel], list[Panel]]:
    step = shrink_step(band.centre)
    centre = rgb(to_unit_float(band.centre[::step, ::step]))
    zoom = whole_zoom(centre.shape[:2], PANEL_SIZE_PX)
    found = [(o.disparity, o.confidence) for o in band.outcomes if o.disparity is not None]
    ranges = [disparity_norm(disparity, confidence) for disparity, confidence in found]
    shared = common_norm(np.array([end for norm in ranges for end in (norm.vmin, norm.vmax)]))
    unit = Normalize(0.0, 1.0)
    extend = (
        colourbar_extend(shared, *(disparity for disparity, _ in found)) if found else "neither"
    )
    disparity_bar = Bar(shared, disparity_colours(), "disparity", extend)
    confidence_bar = Bar(unit, confidence_colours(), "confidence")
    blank = np.ones_like(centre)
    above, below = [Panel(band.title, centre, zoom)], [Panel("", blank, zoom)]
    for outcome in band.outcomes:
        # The end of a long label identifies a file better than its start.
        room = max(20, centre.shape[1] * zoom // LETTER_WIDTH - 12)
        label = outcome.label if len(outcome.label) <= room else f"...{outcome.label[3 - room :]}"
        if outcome.disparity is None or outcome.confidence is None:
            lines = [(line, TEXT) for line in fill(outcome.failure, room).splitlines()]
            above.append(Panel(f"{label}: failed", blank, zoom, corner=lines))
            below.append(Panel("", blank, zoom))
            continue
        last = outcome is band.outcomes[-1]
        for panels, title, values, bar in (
            (above, f"{label}: {outcome.seconds:.1f} s", outcome.disparity, disparity_bar),
            (below, f"{label}: confidence", outcome.confidence, confidence_bar),
        ):
            picture = coloured(values[::step, ::step], bar.norm, bar.colours)
            panels.append(Panel(title, picture, zoom, bar=bar if last else None))
    return above, below


def _band(
    light_field: LightField,
    estimators: dict[str, Estimator],
    disparity_range: tuple[float, float] | None,
) -> Band:
    """Run all estimators on a scene; keep only what the sheet shows."""
    outcomes = []
    for name, estimator in estimators.items():
        label = "/".join(Path(name).parts[-2:])
        try:
            estimate = run_estimator(estimator, light_field, disparity_range=disparity_range)
        except (InputError, RuntimeError, MemoryError) as error:
            outcomes.append(Outcome(label, failure=str(error) or type(error).__name__))
            tqdm.write(f"occjax: {label}: {outcomes[-1].failure}", file=sys.stderr)
            continue
        seconds = estimate.seconds["run"]
        outcomes.append(Outcome(label, estimate.disparity, estimate.confidence, seconds))
        low, high = estimate.disparity_range
        tqdm.write(
            f"{light_field.name}: {label}, disparity searched in [{low:.2f}, {high:.2f}], "
            + ", ".join(f"{phase} {value:.1f} s" for phase, value in estimate.seconds.items())
        )
        for note in estimate.notes:
            tqdm.write(f"  note: {note}")
    (rows, columns), (height, width) = light_field.grid, light_field.image_size
    title = f"{light_field.name}: {rows}x{columns} views of {height}x{width} pixels"
    return Band(title, light_field.centre, tuple(outcomes))


if __name__ == "__main__":
    main(run, __doc__)
