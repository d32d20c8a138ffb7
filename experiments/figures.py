"""The paper's pictures, of any scene: one PNG each, in a folder.

    python -m experiments.figures SCENE -o pictures
    python -m experiments.figures SCENE -o pictures --estimator occcasnet.h5
    python -m experiments.figures SCENE -o pictures --compare A=a.pfm B=b.pfm
    python -m experiments.figures -o pictures --small                  (a minute, no download)

SCENE is anything that ``occjax estimate`` reads.

======================  ==========================================================================
``light_field.png``     sub-aperture images, epipolar plane images and macro-pixels (MacPI)
``angular_patches.png`` an unoccluded point A and an occluded point B as all views see them, and the
                        standard deviations (STD) with and without the occlusion map
``occlusion_maps.png``  occlusion maps of all views; white is occluded
``stages.png``          BadPix 0.07 map and disparity after each stage
``occlusion.png``       error and disparity without and with occlusion maps
``methods.png``         BadPix 0.07 map and disparity of each map that ``--compare`` names, scores
                        in the corner: red is the best, blue the second best of more than two
======================  ==========================================================================

Points and occlusion maps are those of the ground truth, without it of the estimate. A network of
the paper is estimated once more without its occlusion maps for ``occlusion.png``, with the same
weights; ``--without`` names weights that were trained without, as in the paper, or any estimator.
Neither ``light`` nor ``photometric`` has such maps, so without ``--without`` they have no such
picture. BadPix maps and errors need ground truth. ``--small`` compares maps whose scores are
known: the ground truth moved by 0.02, and moved by 0.1 in its left half alone.

Cost: half a minute for 9x9 views of 512x512 pixels on two cores with ``light``; the paper's
network, by its weights, is made for a GPU. Expected: B's deviation is several times that of A and
falls with its occlusion map, though eq. 6 weighs occluded views less rather than leaving them out,
as the last column does; the last stage has far fewer bad pixels than the first.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import numpy as np
from matplotlib.figure import Figure
from tyro.conf import OmitArgPrefixes, Positional, arg

from experiments.angular_patches import (
    angular_patches,
    brightest_of,
    choose_points,
    patches_figure,
)
from experiments.command_line import main
from experiments.compare_methods import known_maps, named
from experiments.cut_outs import cut_out
from experiments.light_field_picture import light_field_figure
from experiments.map_panels import maps_figure
from experiments.real_scenes import named_estimator
from occjax.cli.options import Stored, option
from occjax.data.sample import sample
from occjax.errors import InputError
from occjax.evaluation import read_disparity
from occjax.inference import MODELS, Estimate, Estimator
from occjax.inference.preparation import check_range
from occjax.io.atomic import check_writable
from occjax.lightfield import LightField, to_grey
from occjax.models import load_weights, save_weights
from occjax.models.bundled import find_weights
from occjax.viz import occlusion_figure, save

SMALL = 64
"""Side of the small form's cut-out of the bundled sample, in pixels."""

Points = tuple[tuple[int, int], tuple[int, int]]
"""Row and column of A, then of B."""


def run(
    scene: Positional[
        Annotated[Path | None, option("Folder of views, image or array.", "SCENE")]
    ] = None,
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
    if without == estimator:
        raise InputError(f"--without is {without}, as --estimator; name another, or leave it out")
    if disparity_range is not None:
        check_range(disparity_range)
    made = {name: named_estimator(name) for name in (estimator, without) if name is not None}
    paths = named(compare)
    check_writable(output)
    light_field = cut_out(sample(), SMALL) if scene is None else stored.load(scene)
    maps = read_maps(paths, light_field.image_size)
    if small and not maps:
        assert light_field.ground_truth is not None
        maps = known_maps(light_field.ground_truth)
    chosen = check_points(points, light_field.image_size)
    if maps and light_field.ground_truth is None:
        print("no ground truth: methods are compared by eye alone")

    estimate = made[estimator](light_field, disparity_range=disparity_range)
    pictures = {"light_field": light_field_figure(light_field)}
    pictures |= occlusion_pictures(light_field, estimate, estimator, chosen)
    stages = named_stages(estimate, short(estimator))
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
        pictures["occlusion"] = maps_figure(light_field, both, estimate.confidence, binary=False)
    if maps:
        pictures["methods"] = maps_figure(light_field, maps, binary=True, rank=True)
    for name, figure in pictures.items():
        save(figure, output / f"{name}.png")
    print(f"{', '.join(f'{name}.png' for name in pictures)} in {output}")
    return 0


def read_maps(paths: dict[str, Path], size: tuple[int, int]) -> dict[str, np.ndarray]:
    """Disparity maps of the views' size.

    Args:
        paths: By name.
        size: Height and width of the views.

    Raises:
        InputError: If one cannot be read or has another size.
    """
    maps = {name: read_disparity(path) for name, path in paths.items()}
    for name, disparity in maps.items():
        if disparity.shape != size:
            raise InputError(f"{paths[name]}: is {list(disparity.shape)}, the views {list(size)}")
    return maps


def named_stages(estimate: Estimate, name: str) -> dict[str, np.ndarray]:
    """Disparity after each stage by what the stage is called; one alone by the estimator's name."""
    *earlier, last = estimate.stages
    if not earlier:
        return {name: last}
    names = ["first stage", *(f"stage {number}" for number in range(2, len(earlier) + 1))]
    return {**dict(zip(names, earlier, strict=True)), "last stage": last}


def check_points(points: tuple[int, int, int, int] | None, size: tuple[int, int]) -> Points | None:
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


def occlusion_pictures(
    light_field: LightField, estimate: Estimate, estimator: str, points: Points | None
) -> dict[str, Figure]:
    """Occlusion maps of all views, and angular patches of two points, by the truth if it is whole.

    Args:
        light_field: The views.
        estimate: To refocus on in the place of ground truth.
        estimator: What made it.
        points: A and B; None to look for them. If there are none, there is no such picture.
    """
    truth = light_field.ground_truth
    if truth is not None and np.isfinite(truth).all():
        disparity, source = truth, "ground truth"
    else:
        disparity, source = estimate.disparity, f"estimate of {short(estimator)}"
    patches = angular_patches(light_field, disparity)
    white = brightest_of(patches.occlusion)
    pictures = {
        "occlusion_maps": occlusion_figure(
            np.clip(patches.occlusion / white, 0.0, 1.0),
            title=f"Occlusion maps M by the {source}: white is occluded ({white:.2f} or more)",
        )
    }
    try:
        points = points or choose_points(disparity, to_grey(light_field.centre), patches)
        note = f"Refocused on the {source}."
        pictures["angular_patches"] = patches_figure(light_field, patches, points, note)
    except InputError as error:
        print(f"angular_patches.png is left out: {error}")
    return pictures


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
    if config.views is None:
        return None
    blind = config.with_stages(occlusion="none")
    if blind == config:
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "without.safetensors"
        save_weights(path, variables, blind)
        return Estimator(weights=path)(light_field, disparity_range=disparity_range)


def short(name: str) -> str:
    """The end of a long name."""
    return name if len(name) <= 30 else f"...{name[-27:]}"


if __name__ == "__main__":
    main(run, __doc__)
