"""The paper's pictures, of any scene: one PNG each, in a folder.

    python -m experiments.figures SCENE -o pictures
    python -m experiments.figures SCENE -o pictures --estimator occcasnet.h5
    python -m experiments.figures SCENE -o pictures --compare A=a.pfm B=b.pfm    (with ground truth)
    python -m experiments.figures -o pictures --small                  (a minute, no download)

SCENE is anything that ``occjax estimate`` reads.

======================  ==========================================================================
``light_field.png``     sub-aperture images, epipolar plane images and MacPI
``angular_patches.png`` an unoccluded point A and an occluded point B as all views see them, and the
                        standard deviations (STD) with and without the occlusion map
``occlusion_maps.png``  occlusion maps of all views; white is occluded
``stages.png``          BadPix 0.07 map and disparity, of a network after its first and last stage
``occlusion.png``       error and disparity without and with occlusion maps
``methods.png``         disparity and error of each map that ``--compare`` names, scores in the
                        corner
======================  ==========================================================================

Points and occlusion maps are those of the ground truth, without it of the estimate. A network of
the paper is estimated once more without its occlusion maps for ``occlusion.png``, with the same
weights; ``--without`` names weights that were trained without, as in the paper, or any estimator.
Neither ``light`` nor ``photometric`` has such maps, so without ``--without`` they have no such
picture. BadPix maps and errors need ground truth.

Cost: a minute or two for 9x9 views of 512x512 pixels on two cores with ``light``; the paper's
network, by its weights, is made for a GPU. Expected: B's deviation is several times that of A and
falls with its occlusion map, though eq. 6 weighs occluded views less rather than leaving them out
(the last column does); the last stage has far fewer bad pixels than the first.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from matplotlib.figure import Figure
from tyro.conf import OmitArgPrefixes, Positional, arg

from experiments.angular_patches import angular_patches, choose_points, patches_figure
from experiments.command_line import main
from experiments.compare_methods import named
from experiments.cut_outs import cut_out
from experiments.figure_panels import (
    Bar,
    Panel,
    badpix_picture,
    coloured,
    panel_figure,
    rgb,
    shrink_step,
)
from experiments.real_scenes import named_estimator
from occjax.cli.options import Stored, option
from occjax.data.sample import sample
from occjax.errors import InputError
from occjax.evaluation import read_disparity
from occjax.inference import MODELS, Estimate, Estimator
from occjax.inference.outputs import compare as measured
from occjax.io.atomic import check_writable
from occjax.io.mosaics import join_macpi, join_tiles
from occjax.lightfield import LightField, to_grey, to_unit_float
from occjax.models import load_weights, save_weights
from occjax.models.bundled import find_weights
from occjax.viz import occlusion_figure, save
from occjax.viz.canvas import whole_zoom
from occjax.viz.colour import cut_ends, disparity_colours, disparity_limits
from occjax.viz.figures import BAD, error_picture, error_scale

SMALL = 64
"""Side of the small form's cut-out of the bundled sample, in pixels."""

GAP, EPI_LINE = 2, 6
"""Pixels between sub-aperture images, and height of a view's line of an epipolar plane image."""

Maps = Mapping[str, np.ndarray]
"""Disparity ``[H, W]`` of each method or stage by its name."""


def run(
    scene: Positional[
        Annotated[Path | None, option("Folder of views, image or array.", "SCENE")]
    ] = (None),
    *,
    output: Annotated[Path, arg(aliases=["-o"], metavar="FOLDER", help="Folder of the pictures.")],
    estimator: Annotated[str, arg(help="A model by name, or weights by file.")] = "light",
    without: Annotated[
        str | None, option("Estimator without occlusion maps, to compare with.", "ESTIMATOR")
    ] = None,
    compare: Annotated[
        tuple[str, ...], arg(metavar="NAME=MAP...", help="Disparity maps of methods to compare.")
    ] = (),
    points: Annotated[
        tuple[int, int, int, int] | None,
        option("Row and column of A, then of B, in place of those that are found.", "Y X Y X"),
    ] = None,
    disparity_range: Annotated[
        tuple[float, float] | None, option("Disparities to search.", "MIN MAX")
    ] = None,
    stored: OmitArgPrefixes[Stored] = Stored(),
    small: Annotated[bool, arg(help="A cut-out of the bundled sample.")] = False,
) -> int:
    """Draw every picture that the scene allows."""
    if (scene is None) != small:
        raise InputError("name one scene, or try with --small, which brings its own")
    made = {name: named_estimator(name) for name in (estimator, without) if name is not None}
    paths = named(compare)
    check_writable(output)
    light_field = cut_out(sample(), SMALL) if scene is None else stored.load(scene)
    truth, size = light_field.ground_truth, light_field.image_size
    maps = {name: read_disparity(path) for name, path in paths.items()}
    for name, disparity in maps.items():
        if disparity.shape != size:
            raise InputError(f"{paths[name]}: is {list(disparity.shape)}, the views {list(size)}")
    chosen = check_points(points, size)
    if maps and truth is None:
        print("no ground truth: methods are compared by eye alone")

    estimate = made[estimator](light_field, disparity_range=disparity_range)
    pictures = {"light_field": light_field_figure(light_field)}
    exact = truth is not None and bool(np.isfinite(truth).all())
    disparity = truth if exact and truth is not None else estimate.disparity
    source = "ground truth" if exact else f"estimate of {estimator}"
    patches = angular_patches(light_field, disparity)
    pictures["occlusion_maps"] = occlusion_figure(
        patches.occlusion, title=f"Occlusion maps by the {source}: white is occluded"
    )
    try:
        chosen = chosen or choose_points(disparity, to_grey(light_field.centre), patches)
        note = f"Refocused on the {source}. M: occlusion map; STD of grey; weights (1 - M)^2."
        pictures["angular_patches"] = patches_figure(light_field, patches, chosen, note)
    except InputError as error:
        print(f"angular_patches.png is left out: {error}")
    stages = {} if estimate.coarse is None else {"first stage": estimate.coarse}
    stages["last stage" if stages else short(estimator)] = estimate.disparity
    pictures["stages"] = maps_figure(light_field, stages, estimate.confidence, binary=True)
    other = (
        made[without](light_field, disparity_range=disparity_range)
        if without is not None
        else without_maps(estimator, light_field, disparity_range)
    )
    if other is None:
        print(f"occlusion.png is left out: {estimator} has no occlusion maps; see --without")
    else:
        names = ("without", "with occlusion maps") if without is None else (without, estimator)
        both = dict(zip(map(short, names), (other.disparity, estimate.disparity), strict=True))
        pictures["occlusion"] = maps_figure(light_field, both, estimate.confidence)
    if maps:
        pictures["methods"] = maps_figure(light_field, maps)
    for name, figure in pictures.items():
        save(figure, output / f"{name}.png")
    print(f"{', '.join(f'{name}.png' for name in pictures)} in {output}")
    return 0


def check_points(
    points: tuple[int, int, int, int] | None, size: tuple[int, int]
) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """Two points of an image.

    Raises:
        InputError: If one lies outside.
    """
    if points is None:
        return None
    first, second = points[:2], points[2:]
    for y, x in (first, second):
        if not (0 <= y < size[0] and 0 <= x < size[1]):
            raise InputError(f"the point {y} {x} is outside of the {size[0]}x{size[1]} pixels")
    return first, second


def without_maps(
    name: str, light_field: LightField, disparity_range: tuple[float, float] | None
) -> Estimate | None:
    """What a network finds when every view is taken for visible, or None if it never judges that.

    Args:
        name: Model by name, or weights by file.
        light_field: The views.
        disparity_range: ``(minimum, maximum)`` to search.
    """
    if name in MODELS:
        return None
    variables, config = load_weights(find_weights(name))
    stages = tuple(replace(stage, occlusion="none") for stage in config.stages)
    if config.views is None or stages == config.stages:
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "without.safetensors"
        save_weights(path, variables, replace(config, stages=stages))
        return Estimator(weights=path)(light_field, disparity_range=disparity_range)


def light_field_figure(light_field: LightField) -> Figure:
    """Sub-aperture images, epipolar plane images and a part of the MacPI image.

    Args:
        light_field: The views.
    """
    (rows, columns), (height, width) = light_field.grid, light_field.image_size
    step = -(-max(rows * height, columns * width) // 648)
    y, x = height // 2, width // 2
    across, down = light_field.views[rows // 2, :, y], light_field.views[:, columns // 2, :, x]
    side = max(1, 216 // max(rows, columns))
    lenses = join_macpi(
        to_unit_float(light_field.views[:, :, *window(y, x, side, (height, width))])
    )
    return panel_figure(
        [
            [
                Panel(
                    f"(a) {rows}x{columns} sub-aperture images", rgb(tiled(light_field.views, step))
                )
            ],
            [Panel(f"(b) epipolar plane image of row {y}: column across, u down", *epi(across))],
            [Panel(f"(b) epipolar plane image of column {x}: row across, v down", *epi(down))],
            [Panel(f"(c) macro-pixel image of {side}x{side} pixels in the middle", rgb(lenses), 2)],
        ]
    )


def tiled(views: np.ndarray, step: int) -> np.ndarray:
    """All views in one image, ``step`` x ``step`` pixels averaged, with gaps between the views.

    Args:
        views: ``[V, U, H, W, C]`` as stored.
        step: 1 or more.

    Returns:
        ``[rows, columns, C]`` in [0, 1].
    """
    v, u, h, w, c = views.shape
    rows, columns = max(1, h // step), max(1, w // step)
    small = [
        to_unit_float(view)[: rows * step, : columns * step]
        .reshape(rows, min(step, h), columns, min(step, w), c)
        .mean((1, 3))
        for view in views.reshape(v * u, h, w, c)
    ]
    gap = [(0, 0), (0, 0), (0, GAP), (0, GAP), (0, 0)]
    separate = np.pad(np.reshape(small, (v, u, rows, columns, c)), gap, constant_values=1.0)
    return join_tiles(separate)[:-GAP, :-GAP]


def epi(line: np.ndarray) -> tuple[np.ndarray, int]:
    """An epipolar plane image ``[views, pixels, C]``, stretched, and the zoom to show it at."""
    zoom = whole_zoom(line.shape[:2])
    return rgb(to_unit_float(line).repeat(max(1, EPI_LINE // zoom), axis=0)), zoom


def window(y: int, x: int, side: int, size: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns of a square around a pixel."""
    top, left = (max(0, place - side // 2) for place in (y, x))
    return slice(top, min(size[0], top + side)), slice(left, min(size[1], left + side))


def maps_figure(
    light_field: LightField,
    maps: Maps,
    confidence: np.ndarray | None = None,
    *,
    binary: bool = False,
) -> Figure:
    """Disparities side by side in the same colours, below their errors with scores in the corner.

    Args:
        light_field: With ground truth, or there are no errors.
        maps: Disparity by name.
        confidence: ``[H, W]`` in [0, 1], to keep wild values out of the range of the colours.
        binary: Whether errors are shown as good and bad pixels alone.
    """
    truth = light_field.ground_truth
    first = next(iter(maps.values()))
    norm = disparity_limits(first, confidence, truth)
    colours, step = disparity_colours(), shrink_step(first)
    zoom = max(1, whole_zoom(first[::step, ::step].shape))
    bar = Bar(norm, colours, "disparity [pixels per view step]", cut_ends(norm, *maps.values()))
    centre = rgb(to_unit_float(light_field.centre)[::step, ::step])
    below = [
        Panel(name, coloured(disparity[::step, ::step], norm, colours), zoom)
        for name, disparity in maps.items()
    ]
    if truth is None:
        return panel_figure([[Panel("centre view", centre, zoom), *with_bar(below, bar)]])
    below.insert(0, Panel("ground truth", coloured(truth[::step, ::step], norm, colours), zoom))
    error_norm, error_colours, _ = error_scale(BAD)
    above = [Panel("centre view", centre, zoom)]
    for name, disparity in maps.items():
        pair = disparity[::step, ::step], truth[::step, ::step]
        picture = (
            badpix_picture(*pair, BAD)
            if binary
            else error_picture(*pair, error_norm, error_colours)
        )
        title = f"{name}: {'bad pixels' if binary else 'estimate - ground truth'}"
        above.append(Panel(title, picture, zoom, corner=scores(disparity, truth)))
    if not binary:
        above = with_bar(above, Bar(error_norm, error_colours, "error", "both"))
    note = "" if not binary else f"Red: error above {BAD:g} pixels per view step."
    return panel_figure([above, with_bar(below, bar)], note)


def short(name: str) -> str:
    """The end of a long name."""
    return name if len(name) <= 30 else f"...{name[-27:]}"


def with_bar(panels: Sequence[Panel], bar: Bar) -> list[Panel]:
    """The panels, the last with a colour bar."""
    return [*panels[:-1], replace(panels[-1], bar=bar)]


def scores(disparity: np.ndarray, truth: np.ndarray) -> str:
    """BadPix and MSE as the corner of an error map has them."""
    metrics = measured(disparity, truth)
    if metrics is None:
        return ""
    bad = (f"BadPix {threshold:g}: {metrics.badpix[threshold]:.2f} %" for threshold in (0.07, 0.03))
    return "\n".join([*bad, f"MSE x100: {metrics.mse_x100:.3f}"])


if __name__ == "__main__":
    main(run, __doc__)
