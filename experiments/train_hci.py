"""The published training on the HCI 4D benchmark, end to end.

    python -m experiments.train_hci HCI -o runs/hci
    python -m experiments.train_hci HCI -o runs/hci --minutes 55     (a part; again to go on)
    python -m experiments.train_hci -o runs/small --small            (a minute, no download)

HCI is a folder with the benchmark's 16 additional scenes, to train on, and the eight scenes whose
ground truth is public, to validate on, as its archives unpack (``additional/antinous`` and so on).
The published training leaves out the reflective regions of kitchen, museum and vinyl. They are
masked by ``mask.png`` in the scene's folder, not black where it is masked; or by the images that
published trainings share, ``additional_invalid_area/<scene>/*.png``, opaque where it is masked,
in HCI or anywhere with ``--masks FOLDER``. ``--without-masks`` trains though some are missing.

Cost: 480,000 steps of 32 patches, for a GPU. After every 4000 steps the eight scenes are validated
as whole images; ``training/best.safetensors`` has the least mean BadPix 0.07. At the end, or when
the time is up, it is scored again, as whole images and as the published code did: nine crops of
half the size (256 pixels), a quarter (128) apart, whose disparities are averaged where they
overlap. Both are printed and written as ``scores.md``, beside what the paper's ablation says, which
is what to expect: BadPix 0.07 of 1.733 and MSE x100 of 0.762. Nobody has run this at full size yet.
The small form shows nothing but that it runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import imageio.v3 as imageio
import numpy as np
import tyro
from PIL import Image

from experiments.command_line import main
from experiments.hci_scenes import MASKS, find_scene
from experiments.networks import TABLE_3
from experiments.paper_training import base_recipe
from occjax.cli.options import option
from occjax.data.folders import published_source
from occjax.data.samples import Sample
from occjax.data.scenes import GROUND_TRUTH, MASK, load_scenes
from occjax.data.scenes import Scene as TrainingScene
from occjax.errors import InputError
from occjax.evaluation import evaluate
from occjax.io import read_image, write_pfm
from occjax.io.atomic import atomic_path, check_writable
from occjax.io.submission import STRATIFIED, TRAINING
from occjax.models import load_weights
from occjax.training import Recipe, Scene, recipe, scenes_from_folders, train, validate
from occjax.training.data import validation_scenes
from occjax.training.loop import BEST_FILE
from occjax.training.validation import predict

ADDITIONAL = (
    *("antinous", "boardgames", "dishes", "greek", "kitchen", "medieval2", "museum", "pens"),
    *("pillows", "platonic", "rosemary", "table", "tomb", "tower", "town", "vinyl"),
)
"""The benchmark's scenes to train on."""

REFLECTIVE = ("kitchen", "museum", "vinyl")
"""Those with regions whose ground truth is of a surface that shows something else."""

VALIDATION = (*STRATIFIED, *TRAINING)

SMALL_TRAINING, SMALL_VALIDATION = ("antinous", "kitchen"), ("boxes",)
SMALL_SIZE, SMALL_STEPS = 64, 4

Scores = Mapping[str, float]


def run(
    hci: tyro.conf.Positional[Annotated[Path | None, option("The benchmark's scenes.", "HCI")]] = (
        None
    ),
    *,
    output: Annotated[
        Path, tyro.conf.arg(aliases=["-o"], help="Folder of the training; gone on with.")
    ],
    masks: Annotated[Path | None, option("Folder with masks of reflective regions.", "DIR")] = None,
    without_masks: Annotated[bool, tyro.conf.arg(help="Train though masks are missing.")] = False,
    steps: Annotated[int | None, option("Steps in place of the recipe's.", "N")] = None,
    minutes: Annotated[float | None, option("Stop after this long; go on later.", "M")] = None,
    seed: Annotated[int, tyro.conf.arg(help="Of first weights and data.")] = 0,
    small: Annotated[bool, tyro.conf.arg(help="A tiny network, on scenes of its own.")] = False,
) -> dict[str, dict[str, float]]:
    """Train on the HCI benchmark as published, or go on with it, and score the best weights."""
    if (hci is None) != small:
        raise InputError("give the folder of the benchmark's scenes, or --small alone")
    check_writable(output)
    folder = output / "training"
    learnt: tuple[str, ...]
    held_out: tuple[str, ...]
    if hci is None:
        hci = output / "scenes"
        write_small_scenes(hci)
        base, learnt, held_out = small_recipe(steps), SMALL_TRAINING, SMALL_VALIDATION
    else:
        base = base_recipe("published", data=[hci], steps=steps)
        learnt, held_out = ADDITIONAL, VALIDATION
    places = places_of(hci, (*learnt, *held_out))
    masked = mask_files(hci, places, masks, needed=not without_masks)
    training = configured(base, places, learnt, minutes=minutes, seed=seed)
    data, network = training.data, training.train.network
    assert network.views is not None
    scenes = [
        with_mask(scene, masked.get(scene.name))
        for scene in load_scenes(data.folders, views=network.views)
    ]
    validation = scenes_from_folders([places[name] for name in held_out], training.train)
    trained = train(
        training.train,
        published_source(scenes, data.batch_size, data.seed),
        folder,
        run=training.run,
        validation=validation,
        data={**asdict(data), "masked": sorted(masked)},
    )
    if not trained.finished:
        print(f"stopped after step {int(trained.state.step)}; start again to go on")
    if not (folder / BEST_FILE).is_file():
        print("not validated yet")
        return {}
    scores = score_best(folder / BEST_FILE, training, validation)
    text = table(scores)
    with atomic_path(output / "scores.md") as path:
        path.write_text(text + "\n", encoding="utf-8")
    print(text)
    return scores


def places_of(hci: Path, names: Sequence[str]) -> dict[str, Path]:
    """Folders of scenes, all of which are there with ground truth.

    Args:
        hci: Where the benchmark's archives were unpacked.
        names: Of the scenes.

    Raises:
        InputError: Naming all scenes that are missing, or all without ground truth.
    """
    found = {name: find_scene(hci, name) for name in names}
    missing = [name for name, place in found.items() if place is None]
    if missing:
        raise InputError(
            f"{hci}: has no folder of {', '.join(missing)}, here or one level below; get the "
            "benchmark's archives 'additional', 'stratified' and 'training'"
        )
    places = {name: place for name, place in found.items() if place is not None}
    blind = [name for name, place in places.items() if not (place / GROUND_TRUTH).is_file()]
    if blind:
        raise InputError(f"{hci}: {GROUND_TRUTH} is missing of {', '.join(blind)}; unpack it again")
    return places


def mask_files(
    hci: Path, places: Mapping[str, Path], masks: Path | None, *, needed: bool = True
) -> dict[str, Path]:
    """Files that mask the reflective regions, by scene.

    Args:
        hci: Where the benchmark's archives were unpacked; where masks are found by default.
        places: Folders of the scenes; a mask in one comes first.
        masks: Folder of folders of the scenes, each with one image.
        needed: Whether every reflective scene must have one.

    Raises:
        InputError: If a needed mask is missing, or might be any of several.
    """
    if masks is not None and not masks.is_dir():
        raise InputError(f"{masks}: there is no such folder of masks; check the path")
    found, missing = {}, []
    for name in (name for name in REFLECTIVE if name in places):
        own = [places[name] / MASK]
        images = own if own[0].is_file() else sorted(((masks or hci / MASKS) / name).glob("*.png"))
        if len(images) > 1:
            raise InputError(f"{images[0].parent}: has {len(images)} images; leave only the mask")
        if images:
            found[name] = images[0]
        else:
            missing.append(name)
    if missing and needed:
        raise InputError(
            f"{hci}: {', '.join(missing)} have reflective regions and no {MASK}; pass --masks "
            "FOLDER with FOLDER/<scene>/*.png, or --without-masks to train on these regions too"
        )
    return found


def with_mask(scene: TrainingScene, path: Path | None) -> TrainingScene:
    """A scene of which the masked part is not learnt from.

    Args:
        scene: As it was read.
        path: Image whose opaque pixels are masked, or without opacity those that are not black;
            None for no other mask than the scene came with.

    Raises:
        InputError: If it cannot be read or has another size.
    """
    if path is None:
        return scene
    read_image(path)  # whatever is no image is refused, in words for people
    with Image.open(path) as image:
        opacity = image.getchannel("A") if "A" in image.getbands() else image.convert("L")
        masked = np.asarray(opacity) > 0
    if masked.shape != scene.disparity.shape:
        raise InputError(
            f"{path}: is {list(masked.shape)} but the views are {list(scene.disparity.shape)}"
        )
    return replace(scene, valid=scene.valid & ~masked, masked=True)


def configured(
    base: Recipe,
    places: Mapping[str, Path],
    learnt: Sequence[str],
    *,
    minutes: float | None,
    seed: int,
) -> Recipe:
    """The training of a recipe on some of these scenes."""
    return replace(
        base,
        train=replace(base.train, seed=seed),
        data=replace(base.data, folders=tuple(places[name] for name in learnt), seed=seed),
        run=replace(base.run, minutes=minutes),
    )


def score_best(
    weights: Path, training: Recipe, scenes: Sequence[Scene]
) -> dict[str, dict[str, float]]:
    """Scores of weights on whole images and on averaged crops.

    Args:
        weights: File of the training.
        training: Which network it is, and the border to leave out.
        scenes: With ground truth.

    Returns:
        ``whole`` and ``crops``, each with the names that :func:`occjax.training.validate` gives.
    """
    config, border = training.train, training.run.validation_border
    variables, _ = load_weights(weights, config.network)
    whole = validate(variables, scenes, config, border=border)
    crops: dict[str, float] = {}
    for scene in scenes:
        disparity = averaged_crops(
            lambda crop: np.asarray(predict(variables, crop, config)), scene.sample
        )
        truth, valid = np.asarray(scene.sample.disparity), np.asarray(scene.sample.valid)
        metrics = evaluate(disparity, truth, border=border, mask=valid)
        values = {"mse_x100": metrics.mse_x100}
        values |= {f"badpix_{threshold:g}": value for threshold, value in metrics.badpix.items()}
        for name, value in values.items():
            crops[f"{scene.name}/{name}"] = value
            crops[name] = crops.get(name, 0.0) + value / len(scenes)
    return {"whole": whole, "crops": crops}


def averaged_crops(estimate: Callable[[Sample], np.ndarray], sample: Sample) -> np.ndarray:
    """Disparity of nine overlapping crops of half the size, averaged where they overlap.

    Args:
        estimate: Gives the disparity ``[h, w]`` of a sample.
        sample: A whole light field, without a batch axis.

    Returns:
        ``[H, W]`` disparity.
    """
    size = np.array(sample.disparity.shape)
    side = -(-size // 2)
    total, count = np.zeros(size), np.zeros(size)
    for place in np.ndindex(3, 3):
        top, left = (size - side) * place // 2
        crop = np.s_[..., top : top + side[0], left : left + side[1]]
        images = ("views", "disparity", "visibility", "valid")
        part = sample._replace(**{name: getattr(sample, name)[crop] for name in images})
        total[crop] += estimate(part)
        count[crop] += 1
    return total / count


def table(scores: Mapping[str, Scores]) -> str:
    """Scores of every scene and their mean, as Markdown.

    Args:
        scores: Of :func:`score_best`.
    """
    measures = {"badpix_0.07": "BadPix 0.07", "mse_x100": "MSE x100"}
    head = ["scene", *(f"{title}, {how}" for title in measures.values() for how in scores)]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    names = [name.split("/")[0] for name in scores["whole"] if name.endswith("/mse_x100")]
    for title, prefix in [*((name, f"{name}/") for name in names), ("mean", "")]:
        values = [scores[how][prefix + measure] for measure in measures for how in scores]
        lines.append(f"| {title} | {' | '.join(f'{value:.3f}' for value in values)} |")
    paper = TABLE_3["occcasnet"]
    lines.append(f"| paper, mean of 8 | | {paper.badpix:.3f} | | {paper.mse:.3f} |")
    return "\n".join(lines)


def small_recipe(steps: int | None = None) -> Recipe:
    """A few steps of a tiny network on patches drawn as published."""
    base, steps = recipe("tiny"), SMALL_STEPS if steps is None else steps
    scenes = replace(base.data.scenes, image_size=(SMALL_SIZE, SMALL_SIZE), grid=(9, 9))
    return replace(
        base,
        train=replace(base.train, steps=steps, ema_decay=0.0),
        data=replace(base.data, batch_size=2, procedural_share=0.0, published=True, scenes=scenes),
        run=replace(base.run, validate_every=max(1, steps // 2)),
    )


def write_small_scenes(hci: Path) -> None:
    """Procedural light fields as scenes of the benchmark; a corner of kitchen is masked.

    Args:
        hci: Folder for them.
    """
    names = {f"additional/{name}": name for name in SMALL_TRAINING}
    names |= {f"training/{name}": name for name in SMALL_VALIDATION}
    made = validation_scenes(small_recipe().data, len(names))
    for (place, name), scene in zip(names.items(), made, strict=True):
        folder = hci / place
        folder.mkdir(parents=True, exist_ok=True)
        views = np.rint(255.0 * np.clip(np.asarray(scene.sample.views), 0.0, 1.0)).astype(np.uint8)
        for number, view in enumerate(views.reshape(-1, *views.shape[2:])):
            imageio.imwrite(folder / f"input_Cam{number:03d}.png", np.stack([view] * 3, axis=-1))
        write_pfm(folder / GROUND_TRUTH, np.asarray(scene.sample.disparity))
        if name in REFLECTIVE:
            mask = np.zeros((*views.shape[2:], 4), np.uint8)
            mask[: SMALL_SIZE // 8, : SMALL_SIZE // 8, 3] = 255
            (hci / MASKS / name).mkdir(parents=True, exist_ok=True)
            imageio.imwrite(hci / MASKS / name / "input_Cam040_invalid_ver2.png", mask)


if __name__ == "__main__":
    main(run, __doc__)
