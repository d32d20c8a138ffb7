"""What several estimators make of scenes from real cameras, on one contact sheet.

    python -m experiments.real_scenes SCENE... -o sheet.png
    python -m experiments.real_scenes SCENE... -o sheet.png --estimators light photometric FILE
    python -m experiments.real_scenes -o sheet.png --small         (a minute, no download)

SCENE is anything that ``occjax estimate`` reads: folders of views from a Lytro camera or the
Stanford gantry, images of all views, arrays. An estimator is the name of a model, or a file of
weights. For each scene the sheet shows the centre view, the disparity that each estimator finds,
all in the same colours, their confidence, and the seconds they took once compiled.

Cost: for 9x9 views of 383x552 pixels less than a minute on two cores for ``photometric``
and ``light`` together; the paper's network, by its weights, is made for a GPU. Expected: there is
no ground truth, so this is for looking. The paper's figure shows Dinosaur, Stanford Bunny, Truck
and Knights, where its network keeps backgrounds clean and thin things apart; nobody has made that
figure with this library yet.
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
from PIL import Image
from tqdm import tqdm
from tyro.conf import OmitArgPrefixes, Positional, arg

from experiments.command_line import main
from experiments.cut_outs import cut_out
from occjax.cli.options import Stored, option
from occjax.data.sample import sample
from occjax.errors import InputError
from occjax.inference import MODELS, Estimator
from occjax.inference.preparation import check_range
from occjax.io.atomic import check_writable
from occjax.lightfield import LightField, to_unit_float
from occjax.viz.canvas import BAR_TEXT, BAR_WIDTH, MARGIN, TEXT, Canvas, save, whole_zoom
from occjax.viz.colour import (
    confidence_colours,
    cut_ends,
    disparity_colours,
    disparity_limits,
    limits,
)

SMALL = 64
"""Side of the small form's cut-out of the bundled sample, in pixels."""


@dataclass(frozen=True)
class Outcome:
    """What one estimator made of a scene.

    Attributes:
        label: Name of the estimator.
        disparity: ``[H, W]`` pixels per view step, None if it failed.
        confidence: ``[H, W]`` in [0, 1], None if it failed.
        seconds: Time it took, without compiling.
        failure: Why it failed.
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
        title: What is known of it.
        centre: ``[H, W, C]`` centre view as stored.
        outcomes: One for each estimator.
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
        tuple[str, ...], arg(metavar="ESTIMATOR...", help="Models by name, or weights by file.")
    ] = ("light", "photometric"),
    disparity_range: Annotated[
        tuple[float, float] | None, option("Disparities to search.", "MIN MAX")
    ] = None,
    stored: OmitArgPrefixes[Stored] = Stored(),
    small: Annotated[bool, arg(help="A cut-out of the bundled sample.")] = False,
) -> int:
    """Estimate every scene by every estimator and write the sheet."""
    if output.suffix.lower() != ".png":
        raise InputError(f"{output}: the sheet is a PNG; choose a name that ends with .png")
    if bool(scenes) == small:
        raise InputError("name one scene or more, or try with --small, which brings its own")
    if not estimators:
        raise InputError(f"name an estimator: one of {', '.join(MODELS)}, or a file of weights")
    if disparity_range is not None:
        check_range(disparity_range)
    made = [named_estimator(name) for name in estimators]
    check_writable(output.parent)
    bands, failed = [], False
    for scene in tqdm(scenes or (None,), unit="scene", disable=None):
        try:
            light_field = cut_out(sample(), SMALL) if scene is None else stored.load(scene)
        except InputError as error:
            if len(scenes) == 1:
                raise
            failed = True
            tqdm.write(f"occjax: {error}", file=sys.stderr)
            continue
        bands.append(_band(light_field, estimators, made, disparity_range))
        failed |= any(outcome.failure for outcome in bands[-1].outcomes)
    if not any(outcome.confidence is not None for band in bands for outcome in band.outcomes):
        raise InputError("nothing could be estimated, so there is no sheet")
    device = jax.devices()[0].device_kind
    note = f"Disparity in pixels per view step. Seconds on {device}, once compiled."
    save(sheet(bands, note), output)
    print(f"written to {output}")
    return 1 if failed else 0


def named_estimator(name: str) -> Estimator:
    """An estimator by the name of a model, or the file of its weights.

    Args:
        name: One of :data:`occjax.inference.MODELS`, or a file.

    Raises:
        InputError: If there is neither, or the model needs weights.
    """
    return Estimator(name) if name in MODELS else Estimator(weights=name)


def sheet(bands: Sequence[Band], note: str) -> Figure:
    """The contact sheet: two rows a scene, disparities in common colours above confidences.

    Args:
        bands: The scenes.
        note: A line at the bottom.
    """
    layouts = [_layout(band) for band in bands]
    panels = 1 + max(len(band.outcomes) for band in bands)
    widest = max(width for _, (_, width), _ in layouts)
    canvas = Canvas(
        2 * MARGIN + panels * (widest + GAP) + BAR_WIDTH + BAR_TEXT,
        2 * MARGIN + sum(_height(size) for _, size, _ in layouts) + LINE,
    )
    top = MARGIN
    for band, (step, size, zoom) in zip(bands, layouts, strict=True):
        _draw(canvas, band, top, step, size, zoom)
        top += _height(size)
    _write(canvas, note, MARGIN, top)
    return canvas.figure


GAP, LINE = 14, 24


def _layout(band: Band) -> tuple[int, tuple[int, int], int]:
    """Every which pixel of a scene is shown, the (height, width) of a panel, and its zoom."""
    step = -(-max(band.centre.shape[:2]) // 600)
    height, width = (-(-length // step) for length in band.centre.shape[:2])
    zoom = whole_zoom((height, width), 320)
    return step, (height * zoom, max(width * zoom, 200)), zoom


def _height(size: tuple[int, int]) -> int:
    return LINE + 2 * (LINE + size[0]) + GAP


def _draw(
    canvas: Canvas, band: Band, top: int, step: int, size: tuple[int, int], zoom: int
) -> None:
    """One scene."""
    height, width = size
    rows = (top + 2 * LINE, top + 3 * LINE + height)
    lefts = [MARGIN + number * (width + GAP) for number in range(2 + len(band.outcomes))]
    canvas.figure.text(
        MARGIN / canvas.size[0],
        1.0 - (top + 0.5 * LINE) / canvas.size[1],
        band.title,
        fontsize=11,
        weight="bold",
        va="center",
        color=TEXT,
        parse_math=False,
    )
    _write(canvas, "centre view", lefts[0], rows[0] - LINE)
    canvas.image(_picture(band.centre, step), lefts[0], rows[0], zoom)
    found = [(o.disparity, o.confidence) for o in band.outcomes if o.disparity is not None]
    scales = [disparity_limits(disparity, confidence) for disparity, confidence in found]
    shared = limits(np.array([end for scale in scales for end in (scale.vmin, scale.vmax)]))
    for left, outcome in zip(lefts[1:], band.outcomes, strict=False):
        room = width // 7
        # Room for the seconds, or a word, behind it.
        label = outcome.label
        label = label if len(label) <= room - 12 else f"...{label[15 - room :]}"
        if outcome.disparity is None or outcome.confidence is None:
            _write(canvas, f"{label}: failed", left, rows[0] - LINE)
            _write(canvas, fill(outcome.failure, room), left, rows[0])
            continue
        _write(canvas, f"{label}: {outcome.seconds:.1f} s", left, rows[0] - LINE)
        _write(canvas, f"{label}: confidence", left, rows[1] - LINE)
        # Picked, not averaged: the mean of two sides of an edge is on neither.
        shown = outcome.disparity[::step, ::step]
        canvas.image(shown, left, rows[0], zoom, colours=disparity_colours(), norm=shared)
        shown = outcome.confidence[::step, ::step]
        unit = Normalize(0.0, 1.0)
        canvas.image(shown, left, rows[1], zoom, colours=confidence_colours(), norm=unit)
    if found:
        cut = cut_ends(shared, *(disparity for disparity, _ in found))
        places = [(lefts[-1], row, BAR_WIDTH, height) for row in rows]
        canvas.bar(shared, disparity_colours(), "disparity", places[0], cut=cut)
        canvas.bar(Normalize(0.0, 1.0), confidence_colours(), "confidence", places[1])


def _write(canvas: Canvas, text: str, left: int, top: int) -> None:
    """Text below a line of pixels; of one line, it is in the middle of ``LINE`` pixels."""
    x, y = left / canvas.size[0], 1.0 - (top + 0.25 * LINE) / canvas.size[1]
    canvas.figure.text(x, y, text, fontsize=9.5, va="top", color=TEXT, parse_math=False)


def _picture(centre: np.ndarray, step: int) -> np.ndarray:
    """``[H / step, W / step, 3]`` uint8 picture of a view."""
    pixels = np.floor(np.clip(to_unit_float(centre), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    pixels = np.ascontiguousarray(np.broadcast_to(pixels, (*centre.shape[:2], 3)))
    height, width = (-(-length // step) for length in centre.shape[:2])
    return np.asarray(Image.fromarray(pixels).resize((width, height), Image.Resampling.BOX))


def _band(
    light_field: LightField,
    names: Sequence[str],
    estimators: Sequence[Estimator],
    disparity_range: tuple[float, float] | None,
) -> Band:
    """One scene, estimated; of the estimates only what the sheet shows is kept."""
    outcomes = []
    for name, estimator in zip(names, estimators, strict=True):
        label = name if name in MODELS else "/".join(Path(name).parts[-2:])
        try:
            estimate = estimator(light_field, disparity_range=disparity_range)
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
        for remark in estimate.notes:
            tqdm.write(f"  note: {remark}")
    (rows, columns), (height, width) = light_field.grid, light_field.image_size
    title = f"{light_field.name}: {rows}x{columns} views of {height}x{width} pixels"
    return Band(title, light_field.centre, tuple(outcomes))


if __name__ == "__main__":
    main(run, __doc__)
