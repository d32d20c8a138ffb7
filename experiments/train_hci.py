"""The published training on the HCI 4D benchmark, end to end.

    python -m experiments.train_hci HCI -o runs/hci
    python -m experiments.train_hci HCI -o runs/hci --minutes 55     (stop early; again to resume)
    python -m experiments.train_hci -o runs/small --small            (a minute)

Cost: 480,000 steps of 32 patches, which need a GPU; according to the paper a week on an RTX 3090.
Expected: ``scores.md`` with MSE x100 of 0.762 and BadPix 0.07 of 1.733, as in the paper's table 3.
This has not been run at full size yet.

HCI is a folder with the benchmark's unpacked archives (``additional/antinous`` and so on): its 16
additional scenes are for training, the eight scenes with public ground truth for validation. After
every 4000 steps whole images of these are validated, and ``training/best.safetensors`` keeps the
weights with the smallest mean BadPix 0.07. At the end these weights are scored again, on whole
images and by the method of the published code: the disparities of nine crops of half the size (256
pixels) at a stride of a quarter (128) are averaged where they overlap.

The published training leaves out the reflective regions of kitchen, museum and vinyl. Their masks
are ``mask.png`` in the scene's folder, where masked pixels are not black, or the images that
published trainings share, ``additional_invalid_area/<scene>/*.png``, where masked pixels are
opaque, in HCI or in ``--masks FOLDER``. ``--without-masks`` trains on these regions too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import imageio.v3 as imageio
import numpy as np
import tyro

from experiments.blender.folder import view_name
from experiments.command_line import Small, announce_smoke_test, main
from experiments.cut_outs import SMALL_SIZE_PX, cut_out
from experiments.hci_scenes import MASKS, REFLECTIVE, every_scene, shared_masks, with_mask
from experiments.markdown import markdown_table, write_text
from experiments.networks import TABLE_3, small_form
from experiments.published_training import published_source
from experiments.submission import STRATIFIED, TRAINING
from experiments.training_rows import Scores, base_recipe
from occjax.cli.options import option
from occjax.data.bundled_sample import sample
from occjax.data.scenes import load_scenes
from occjax.errors import InputError
from occjax.estimators import run_estimator
from occjax.estimators.factory import estimator_of
from occjax.io import write_pfm
from occjax.io.atomic import check_writable
from occjax.io.hci_config import GROUND_TRUTH
from occjax.lightfield import LightField
from occjax.models import load_weights
from occjax.training import Recipe, scenes_from_folders, train, validate
from occjax.training.loop import BEST_FILE
from occjax.training.validation import score_scenes

ADDITIONAL = (
    *("antinous", "boardgames", "dishes", "greek", "kitchen", "medieval2", "museum", "pens"),
    *("pillows", "platonic", "rosemary", "table", "tomb", "tower", "town", "vinyl"),
)
"""Training scenes of the benchmark."""

VALIDATION = (*STRATIFIED, *TRAINING)

SMALL_TRAINING, SMALL_VALIDATION = ("antinous", "kitchen"), ("boxes",)
SMALL_STEPS = 2


def run(
    hci: tyro.conf.Positional[
        Annotated[Path | None, option("Folder of the benchmark's scenes.", "HCI")]
    ] = (None),
    *,
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], help="Folder of the training; it is resumed.")
    ],
    masks: Annotated[Path | None, option("Folder with masks of reflective regions.", "DIR")] = None,
    without_masks: Annotated[bool, tyro.conf.arg(help="Accept missing masks.")] = False,
    steps: Annotated[int | None, option("Number of steps instead of the recipe's.", "N")] = None,
    minutes: Annotated[float | None, option("Stop after this time; resume later.", "M")] = None,
    seed: Annotated[int, tyro.conf.arg(help="Seed of the initial weights and the data.")] = 0,
    small: Small = False,
) -> dict[str, dict[str, float]]:
    """Train on the HCI benchmark as published, or resume, and score the best weights."""
    if (hci is None) != small:
        raise InputError("name the folder of the benchmark's scenes, or pass --small alone")
    check_writable(output)
    folder = output / "training"
    trained_on: Sequence[str] = ADDITIONAL
    held_out: Sequence[str] = VALIDATION
    if hci is None:
        announce_smoke_test()
        hci = output / "scenes"
        write_small_scenes(hci)
        trained_on, held_out = SMALL_TRAINING, SMALL_VALIDATION
        steps = SMALL_STEPS if steps is None else steps
    base = base_recipe("published", data=[hci], steps=steps)
    base = smaller(base) if small else base
    places = places_of(hci, (*trained_on, *held_out))
    shared = shared_masks(hci, places, masks, needed=not without_masks)
    training = configured(base, places, trained_on, minutes=minutes, seed=seed)
    data, network = training.data, training.train.network
    scenes = [
        with_mask(scene, shared.get(scene.name))
        for scene in load_scenes(data.folders, views=network.views)
    ]
    validation = scenes_from_folders([places[name] for name in held_out])
    trained = train(
        training.train,
        published_source(scenes, data.batch_size, data.seed),
        folder,
        run=training.run,
        validation=validation,
        data={**asdict(data), "masked": sorted(scene.name for scene in scenes if scene.masked)},
    )
    if not trained.finished:
        print(f"stopped after step {int(trained.state.step)}; run the command again to resume")
    if not (folder / BEST_FILE).is_file():
        print("not validated yet")
        return {}
    scores = score_best(folder / BEST_FILE, training, validation)
    text = table(scores)
    write_text(output / "scores.md", text)
    print(text)
    return scores


def places_of(hci: Path, names: Sequence[str]) -> dict[str, Path]:
    """Return the folders of scenes, which must have ground truth.

    Args:
        hci: Folder with the unpacked archives of the benchmark.
        names: Names of the scenes.

    Raises:
        InputError: If scenes or their ground truth are missing, with all names.
    """
    places = every_scene(
        hci, names, "get the benchmark's archives 'additional', 'stratified' and 'training'"
    )
    blind = [name for name, place in places.items() if not (place / GROUND_TRUTH).is_file()]
    if blind:
        raise InputError(
            f"{hci}: {GROUND_TRUTH} is missing in {', '.join(blind)}; unpack the archive again"
        )
    return places


def configured(
    base: Recipe,
    places: Mapping[str, Path],
    trained_on: Sequence[str],
    *,
    minutes: float | None,
    seed: int,
) -> Recipe:
    """Return the recipe with its scenes, time limit and seed."""
    return replace(
        base,
        train=replace(base.train, seed=seed),
        data=replace(base.data, folders=tuple(places[name] for name in trained_on), seed=seed),
        run=replace(base.run, minutes=minutes),
    )


def score_best(
    weights: Path, training: Recipe, scenes: Sequence[LightField]
) -> dict[str, dict[str, float]]:
    """Score weights on whole images and on averaged crops.

    Args:
        weights: File of weights.
        training: Recipe with the network.
        scenes: Scenes with ground truth.

    Returns:
        Scores ``whole`` and ``crops``, each with the names of :func:`occjax.training.validate`.
    """
    network = training.train.network
    variables, _ = load_weights(weights, network)
    whole = validate(variables, scenes, network)
    estimator = estimator_of(network, variables)

    def whole_image(light_field: LightField) -> np.ndarray:
        return run_estimator(estimator, light_field).disparity

    crops = score_scenes(lambda light_field: averaged_crops(whole_image, light_field), scenes)
    return {"whole": whole, "crops": crops}


def averaged_crops(
    estimate: Callable[[LightField], np.ndarray], light_field: LightField
) -> np.ndarray:
    """Return the disparity of nine crops of half the size, averaged where they overlap.

    Args:
        estimate: Function that returns the disparity ``[h, w]`` of a light field.
        light_field: Whole light field.

    Returns:
        ``[H, W]`` disparity, pixels per view step.
    """
    size = np.array(light_field.image_size)
    side = -(-size // 2)
    total, count = np.zeros(size), np.zeros(size)
    for place in np.ndindex(3, 3):
        top, left = (size - side) * place // 2
        crop = np.s_[top : top + side[0], left : left + side[1]]
        truth = light_field.ground_truth
        part = replace(
            light_field,
            views=light_field.views[:, :, *crop],
            ground_truth=None if truth is None else truth[crop],
            view_order_report=None,
        )
        total[crop] += estimate(part)
        count[crop] += 1
    return total / count


def table(scores: Mapping[str, Scores]) -> str:
    """Return the scores of every scene and their mean, as Markdown.

    Args:
        scores: Result of :func:`score_best`.
    """
    measures = {"badpix_0.07": "BadPix 0.07", "mse_x100": "MSE x100"}
    head = ["scene", *(f"{title}, {how}" for title in measures.values() for how in scores)]
    names = [name.split("/")[0] for name in scores["whole"] if name.endswith("/mse_x100")]
    rows = []
    for title, prefix in [*((name, f"{name}/") for name in names), ("mean", "")]:
        values = [scores[how][prefix + measure] for measure in measures for how in scores]
        rows.append([title, *(f"{value:.3f}" for value in values)])
    paper = TABLE_3["occcasnet"]
    rows.append(["paper, mean of 8", "", f"{paper.badpix:.3f}", "", f"{paper.mse:.3f}"])
    return markdown_table(head, rows, right=True)


def smaller(base: Recipe) -> Recipe:
    """Return the recipe with a small network and two patches a step."""
    return replace(
        base,
        train=replace(base.train, network=small_form(base.train.network)),
        data=replace(base.data, batch_size=2),
        run=replace(base.run, validate_every=max(1, base.train.steps // 2)),
    )


def write_small_scenes(hci: Path) -> None:
    """Write parts of the bundled sample as benchmark scenes; a corner of kitchen is masked.

    Args:
        hci: Folder for the scenes.
    """
    names = {f"additional/{name}": name for name in SMALL_TRAINING}
    names |= {f"training/{name}": name for name in SMALL_VALIDATION}
    whole = sample()
    for number, (place, name) in enumerate(names.items()):
        scene = cut_out(whole, SMALL_SIZE_PX, (SMALL_SIZE_PX, number * SMALL_SIZE_PX))
        folder = hci / place
        folder.mkdir(parents=True, exist_ok=True)
        for view, image in enumerate(scene.views.reshape(-1, *scene.views.shape[2:])):
            imageio.imwrite(folder / view_name(view), image)
        assert scene.ground_truth is not None
        write_pfm(folder / GROUND_TRUTH, scene.ground_truth)
        if name in REFLECTIVE:
            mask = np.zeros((SMALL_SIZE_PX, SMALL_SIZE_PX, 4), np.uint8)
            mask[: SMALL_SIZE_PX // 8, : SMALL_SIZE_PX // 8, 3] = 255
            (hci / MASKS / name).mkdir(parents=True, exist_ok=True)
            imageio.imwrite(hci / MASKS / name / "input_Cam040_invalid_ver2.png", mask)


if __name__ == "__main__":
    main(run, __doc__)
