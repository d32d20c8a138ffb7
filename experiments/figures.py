"""The paper's kinds of figures, of any scene: one PNG file each, in a folder.

    python -m experiments.figures SCENE -o pictures
    python -m experiments.figures SCENE -o pictures --estimator occcasnet.h5
    python -m experiments.figures SCENE -o pictures --compare A=a.pfm B=b.pfm
    python -m experiments.figures -o pictures --small                  (a minute)

SCENE is any input of ``occjax estimate``.

======================  ==========================================================================
``light_field.png``     sub-aperture images, epipolar plane images and macro-pixels (MacPI)
``angular_patches.png`` an unoccluded point A and an occluded point B in all views, and the standard
                        deviations (STD) with and without the occlusion map
``occlusion_maps.png``  occlusion maps of all views; occluded is white
``stages.png``          BadPix 0.07 map and disparity after each stage
``occlusion.png``       error and disparity without and with occlusion maps
``methods.png``         BadPix 0.07 map, disparity and scores of each map of ``--compare``; the best
                        score is red, the second best of more than two is blue
======================  ==========================================================================

Cost: half a minute for 9x9 views of 512x512 pixels on two cores with ``proposal``; the paper's
network needs a GPU. Expected: the deviation of B is several times that of A, and the occlusion map
reduces it. It does not vanish, because eq. 6 reduces the weight of occluded views instead of
removing them; the last column shows the deviation without them. The last stage has far fewer bad
pixels than the first one.

Points and occlusion maps are computed from the ground truth, or without it from the estimate.
``occlusion.png`` needs weights of the paper's network, which is run again without occlusion maps;
use ``--compare`` for weights that were trained without them. BadPix maps and errors need ground
truth. ``--small`` compares maps with known scores: the ground truth plus 0.02, and the ground truth
plus 0.1 in its left half.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from matplotlib.figure import Figure
from tyro.conf import OmitArgPrefixes, Positional, arg

from experiments.angular_patches import angular_patches, choose_points, patches_figure, white_level
from experiments.command_line import Small, announce_smoke_test, main
from experiments.compare_methods import known_maps, parse_named
from experiments.cut_outs import small_sample
from experiments.light_field_picture import light_field_figure
from experiments.map_panels import maps_figure
from experiments.real_scenes import named_estimator
from occjax.cli.options import ViewOrderOptions, option
from occjax.errors import InputError
from occjax.estimators import Estimate, Estimator, run_estimator
from occjax.estimators.occcasnet import OccCasNetEstimator
from occjax.evaluation import read_disparity
from occjax.io.atomic import check_writable
from occjax.lightfield import LightField, to_grey
from occjax.viz import occlusion_figure, save

Points = tuple[tuple[int, int], tuple[int, int]]
"""``(row, column)`` of A and of B."""

Range = tuple[float, float] | None


def run(
    scene: Positional[
        Annotated[Path | None, option("Folder of views, image or array.", "SCENE")]
    ] = None,
    *,
    output: Annotated[Path, arg(aliases=["-o"], metavar="FOLDER", help="Folder of the figures.")],
    estimator: Annotated[str, arg(help="Name of a model, or file of weights.")] = "proposal",
    compare: Annotated[
        tuple[str, ...], arg(metavar="NAME=MAP...", help="Disparity maps of methods to compare.")
    ] = (),
    points: Annotated[
        tuple[int, int, int, int] | None,
        option("Row and column of A, then of B; chosen by default.", "Y X Y X"),
    ] = None,
    disparity_range: Annotated[Range, option("Range of disparities to search.", "MIN MAX")] = None,
    stored: OmitArgPrefixes[ViewOrderOptions] = ViewOrderOptions(),
    small: Small = False,
) -> None:
    """Draw every figure that the scene allows."""
    if (scene is None) != small:
        raise InputError("name one scene, or pass --small alone for a smoke test")
    made = named_estimator(estimator)
    paths = parse_named(compare)
    check_writable(output)
    light_field = small_sample() if scene is None else stored.load(scene)
    maps = read_maps(paths, light_field.image_size)
    if small:
        announce_smoke_test()
        assert light_field.ground_truth is not None
        maps = maps or known_maps(light_field.ground_truth)
    chosen = check_points(points, light_field.image_size)
    if maps and light_field.ground_truth is None:
        print("there is no ground truth: methods.png has no scores")

    estimate = run_estimator(made, light_field, disparity_range=disparity_range)
    figures = {"light_field": light_field_figure(light_field)}
    figures |= occlusion_figures(light_field, estimate, estimator, chosen)
    stages = named_stages(estimate, shorten(estimator))
    figures["stages"] = maps_figure(light_field, stages, estimate.confidence, binary=True)
    without = without_occlusion(made)
    if without is None:
        print(f"occlusion.png is omitted: {estimator} has no occlusion maps")
    else:
        other = run_estimator(without, light_field, disparity_range=disparity_range)
        both = {"without": other.disparity, "with occlusion maps": estimate.disparity}
        figures["occlusion"] = maps_figure(light_field, both, estimate.confidence, binary=False)
    if maps:
        figures["methods"] = maps_figure(light_field, maps, binary=True, rank=True)
    for name, figure in figures.items():
        save(figure, output / f"{name}.png")
    print(f"{', '.join(f'{name}.png' for name in figures)} in {output}")


def read_maps(paths: dict[str, Path], size: tuple[int, int]) -> dict[str, np.ndarray]:
    """Read disparity maps of the views' size.

    Args:
        paths: Files by name.
        size: ``(H, W)`` of the views, in pixels.

    Returns:
        ``[H, W]`` disparity by name.

    Raises:
        InputError: If a map cannot be read or has another size.
    """
    maps = {name: read_disparity(path) for name, path in paths.items()}
    for name, disparity in maps.items():
        if disparity.shape != size:
            raise InputError(f"{paths[name]}: is {list(disparity.shape)}, the views {list(size)}")
    return maps


def named_stages(estimate: Estimate, name: str) -> dict[str, np.ndarray]:
    """Return the disparity after each stage, by a title; a single stage has the given name."""
    *earlier, last = estimate.stages
    if not earlier:
        return {name: last}
    names = ["first stage", *(f"stage {number}" for number in range(2, len(earlier) + 1))]
    return {**dict(zip(names, earlier, strict=True)), "last stage": last}


def check_points(points: tuple[int, int, int, int] | None, size: tuple[int, int]) -> Points | None:
    """Return two points, or None if there are none.

    Raises:
        InputError: If a point lies outside the image.
    """
    if points is None:
        return None
    first, second = points[:2], points[2:]
    for y, x in (first, second):
        if not (0 <= y < size[0] and 0 <= x < size[1]):
            raise InputError(f"the point {y} {x} is outside the {size[0]}x{size[1]} pixels")
    return first, second


def occlusion_figures(
    light_field: LightField, estimate: Estimate, estimator: str, points: Points | None
) -> dict[str, Figure]:
    """Draw the occlusion maps of all views, and the angular patches of two points.

    Args:
        light_field: The views; their ground truth is used if it is complete.
        estimate: Estimate to use without complete ground truth.
        estimator: Name of its estimator.
        points: A and B; None to choose them. If no point is occluded, there is no second figure.

    Returns:
        Figures by file name.
    """
    truth = light_field.ground_truth
    if truth is not None and np.isfinite(truth).all():
        disparity, source = truth, "ground truth"
    else:
        disparity, source = estimate.disparity, f"estimate of {shorten(estimator)}"
    patches = angular_patches(light_field, disparity)
    white = white_level(patches.occlusion)
    figures = {
        "occlusion_maps": occlusion_figure(
            np.clip(patches.occlusion / white, 0.0, 1.0),
            title=f"Occlusion maps M of the {source}: occluded is white ({white:.2f} or more)",
        )
    }
    try:
        points = points or choose_points(disparity, to_grey(light_field.centre), patches)
        note = f"Warped by the {source}."
        figures["angular_patches"] = patches_figure(light_field, patches, points, note)
    except InputError as error:
        print(f"angular_patches.png is omitted: {error}")
    return figures


def without_occlusion(estimator: Estimator) -> Estimator | None:
    """Return a network of the paper without its occlusion maps; None without such maps."""
    if not isinstance(estimator, OccCasNetEstimator):
        return None
    without = estimator.config.with_stages(occlusion="none")
    return None if without == estimator.config else replace(estimator, config=without)


def shorten(name: str) -> str:
    """Return the end of a long name."""
    return name if len(name) <= 30 else f"...{name[-27:]}"


if __name__ == "__main__":
    main(run, __doc__)
