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
overlap. The published code chose its best by these crops, too. Both are printed and written,
as ``scores.md``, beside what the paper's ablation says, which is what to expect: MSE x100 of 0.762
and BadPix 0.07 of 1.733. Nobody has run this at full size yet. The small form, a network of 3x3
views and few channels on cut-outs of the bundled sample, shows nothing but that it runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import imageio.v3 as imageio
import numpy as np
import tyro

from experiments.command_line import main
from experiments.cut_outs import cut_out
from experiments.hci_masks import REFLECTIVE, shared_masks, with_mask
from experiments.hci_scenes import MASKS, every_scene
from experiments.markdown import markdown_table
from experiments.networks import TABLE_3, small_form
from experiments.paper_training import base_recipe
from occjax.cli.options import option
from occjax.data.folders import published_source
from occjax.data.sample import sample
from occjax.data.samples import Sample
from occjax.data.scenes import GROUND_TRUTH, load_scenes
from occjax.errors import InputError
from occjax.io import write_pfm
from occjax.io.atomic import atomic_path, check_writable
from occjax.io.submission import STRATIFIED, TRAINING
from occjax.models import load_weights
from occjax.render.folder import view_name
from occjax.training import Recipe, Scene, scenes_from_folders, train, validate
from occjax.training.loop import BEST_FILE
from occjax.training.validation import predict, score_scenes

ADDITIONAL = (
    *("antinous", "boardgames", "dishes", "greek", "kitchen", "medieval2", "museum", "pens"),
    *("pillows", "platonic", "rosemary", "table", "tomb", "tower", "town", "vinyl"),
)
"""The benchmark's scenes to train on."""

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
    small: Annotated[bool, tyro.conf.arg(help="A small network, on scenes of its own.")] = False,
) -> dict[str, dict[str, float]]:
    """Train on the HCI benchmark as published, or go on with it, and score the best weights."""
    if (hci is None) != small:
        raise InputError("give the folder of the benchmark's scenes, or --small alone")
    check_writable(output)
    folder = output / "training"
    learnt: Sequence[str] = ADDITIONAL
    held_out: Sequence[str] = VALIDATION
    if hci is None:
        hci = output / "scenes"
        write_small_scenes(hci)
        learnt, held_out = SMALL_TRAINING, SMALL_VALIDATION
        steps = SMALL_STEPS if steps is None else steps
    base = base_recipe("published", data=[hci], steps=steps)
    base = smaller(base) if small else base
    places = places_of(hci, (*learnt, *held_out))
    shared = shared_masks(hci, places, masks, needed=not without_masks)
    training = configured(base, places, learnt, minutes=minutes, seed=seed)
    data, network = training.data, training.train.network
    assert network.views is not None
    scenes = [
        with_mask(scene, shared.get(scene.name))
        for scene in load_scenes(data.folders, views=network.views)
    ]
    validation = scenes_from_folders([places[name] for name in held_out], training.train)
    trained = train(
        training.train,
        published_source(scenes, data.batch_size, data.seed),
        folder,
        run=training.run,
        validation=validation,
        data={**asdict(data), "masked": sorted(scene.name for scene in scenes if scene.masked)},
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
    places = every_scene(
        hci, names, "get the benchmark's archives 'additional', 'stratified' and 'training'"
    )
    blind = [name for name, place in places.items() if not (place / GROUND_TRUTH).is_file()]
    if blind:
        raise InputError(f"{hci}: {GROUND_TRUTH} is missing of {', '.join(blind)}; unpack it again")
    return places


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

    def whole_image(sample: Sample) -> np.ndarray:
        return np.asarray(predict(variables, sample, config))

    crops = score_scenes(lambda sample: averaged_crops(whole_image, sample), scenes, border=border)
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
    names = [name.split("/")[0] for name in scores["whole"] if name.endswith("/mse_x100")]
    rows = []
    for title, prefix in [*((name, f"{name}/") for name in names), ("mean", "")]:
        values = [scores[how][prefix + measure] for measure in measures for how in scores]
        rows.append([title, *(f"{value:.3f}" for value in values)])
    paper = TABLE_3["occcasnet"]
    rows.append(["paper, mean of 8", "", f"{paper.badpix:.3f}", "", f"{paper.mse:.3f}"])
    return markdown_table(head, rows, right=True)


def smaller(base: Recipe) -> Recipe:
    """The same training of a network of 3x3 views and few channels, on two patches a step."""
    return replace(
        base,
        train=replace(base.train, network=small_form(base.train.network)),
        data=replace(base.data, batch_size=2),
        run=replace(base.run, validate_every=max(1, base.train.steps // 2)),
    )


def write_small_scenes(hci: Path) -> None:
    """Cut-outs of the bundled sample as scenes of the benchmark; a corner of kitchen is masked.

    Args:
        hci: Folder for them.
    """
    names = {f"additional/{name}": name for name in SMALL_TRAINING}
    names |= {f"training/{name}": name for name in SMALL_VALIDATION}
    whole = sample()
    for number, (place, name) in enumerate(names.items()):
        scene = cut_out(whole, SMALL_SIZE, (SMALL_SIZE, number * SMALL_SIZE))
        folder = hci / place
        folder.mkdir(parents=True, exist_ok=True)
        for view, image in enumerate(scene.views.reshape(-1, *scene.views.shape[2:])):
            imageio.imwrite(folder / view_name(view), image)
        assert scene.ground_truth is not None
        write_pfm(folder / GROUND_TRUTH, scene.ground_truth)
        if name in REFLECTIVE:
            mask = np.zeros((SMALL_SIZE, SMALL_SIZE, 4), np.uint8)
            mask[: SMALL_SIZE // 8, : SMALL_SIZE // 8, 3] = 255
            (hci / MASKS / name).mkdir(parents=True, exist_ok=True)
            imageio.imwrite(hci / MASKS / name / "input_Cam040_invalid_ver2.png", mask)


if __name__ == "__main__":
    main(run, __doc__)
