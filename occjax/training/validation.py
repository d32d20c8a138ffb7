"""Scores and pictures of light fields that training does not use."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import imageio.v3 as imageio
import jax
import numpy as np
from jaxtyping import Array, Float

from occjax.data.samples import LightFieldSample, numpy_sample, select_views, to_device
from occjax.errors import InputError
from occjax.evaluation import evaluate
from occjax.evaluation.metrics import BAD_PIXEL_THRESHOLD
from occjax.io import load
from occjax.io.atomic import atomic_path
from occjax.lightfield import view_offsets
from occjax.training.config import TrainConfig
from occjax.training.tasks import task_of
from occjax.view_selection import Selection
from occjax.viz.colour import disparity_colours, error_colours, limits

SELECTION_METRIC = f"badpix_{BAD_PIXEL_THRESHOLD:g}"
"""Name of the score whose mean over the scenes selects the best checkpoint."""

ERROR_LIMIT = 0.3
"""Error at which the colours of the error map end, pixels per view step."""


class ValidationScene(NamedTuple):
    """A light field with ground truth.

    Attributes:
        name: Name of its picture and of its scores in the log.
        sample: The light field, without a batch axis.
    """

    name: str
    sample: LightFieldSample


def validate(
    variables: dict,
    scenes: Sequence[ValidationScene],
    config: TrainConfig,
    *,
    border: int,
    pictures: Path | None = None,
) -> dict[str, float]:
    """Compute the scores of a model on each scene, and their means.

    Args:
        variables: Variables of the model.
        scenes: At least one scene.
        config: Settings of the training.
        border: Pixels left out at each side.
        pictures: Folder for one picture per scene: truth, estimate and error next to each other.

    Returns:
        ``mse_x100``, ``badpix_0.07``, ``badpix_0.03`` and ``badpix_0.01``, the means over the
        scenes, and the same for each scene as ``<scene>/<measure>``.

    Example:
        >>> from occjax.models import preset, variable_shapes
        >>> config = TrainConfig(preset("tiny"))
        >>> views = np.zeros((3, 3, 16, 16), np.float32)
        >>> sample = numpy_sample(views, view_offsets(3, 3), views[1, 1])
        >>> zeros = jax.tree.map(lambda leaf: np.zeros(leaf.shape), variable_shapes(config.network))
        >>> scores = validate(zeros, [ValidationScene("flat", sample)], config, border=2)
        >>> scores["badpix_0.07"] == scores["flat/badpix_0.07"]
        True
    """
    return score_scenes(
        lambda sample: np.asarray(predict(variables, sample, config)),
        scenes,
        border=border,
        pictures=pictures,
    )


def score_scenes(
    estimate: Callable[[LightFieldSample], np.ndarray],
    scenes: Sequence[ValidationScene],
    *,
    border: int,
    pictures: Path | None = None,
) -> dict[str, float]:
    """Compute the scores of any estimator on each scene, and their means.

    Args:
        estimate: Function that returns the disparity ``[h, w]`` of a sample.
        scenes: At least one scene.
        border: Pixels left out at each side.
        pictures: Folder for one picture per scene, see :func:`validate`.

    Returns:
        Scores with the names of :func:`validate`.
    """
    scores: dict[str, float] = {}
    for name, sample in scenes:
        disparity = estimate(sample)
        truth, valid = np.asarray(sample.disparity), np.asarray(sample.valid)
        metrics = evaluate(disparity, truth, border=border, mask=valid)
        badpix = {f"badpix_{threshold:g}": value for threshold, value in metrics.badpix.items()}
        for measure, value in {"mse_x100": metrics.mse_x100, **badpix}.items():
            scores[f"{name}/{measure}"] = value
            scores[measure] = scores.get(measure, 0.0) + value / len(scenes)
        if pictures is not None:
            with atomic_path(pictures / f"{name}.png") as path:
                imageio.imwrite(path, picture(disparity, np.where(valid, truth, np.nan)))
    return scores


@partial(jax.jit, static_argnames="config")
def predict(variables: dict, sample: LightFieldSample, config: TrainConfig) -> Float[Array, "h w"]:
    """Estimate the disparity of one light field of any size, as ``occjax estimate`` does.

    Args:
        variables: Variables of the model.
        sample: One light field (no batch axis).
        config: Settings of the training.

    Returns:
        ``[h, w]`` disparity, pixels per view step.
    """
    return task_of(config.network, config.loss, config.precision).predict(variables, sample)


def scenes_from_folders(
    folders: Sequence[str | Path], config: TrainConfig, *, views: Selection = "all"
) -> list[ValidationScene]:
    """Read light fields with ground truth, with the views that the model takes.

    Args:
        folders: Anything that :func:`occjax.load` reads.
        config: Settings of the training.
        views: Views to use, if the model takes any arrangement of views.

    Returns:
        The scenes, named after their folders.

    Raises:
        InputError: If a light field cannot be read, has no ground truth, or has fewer views than
            the model takes.

    Example:
        >>> import tempfile
        >>> from occjax.data.bundled_sample import sample
        >>> from occjax.io import write_arrays
        >>> from occjax.training import recipe
        >>> path = Path(tempfile.mkdtemp()) / "cotton.npz"
        >>> write_arrays(path, sample().central(3, 3))
        >>> scenes = scenes_from_folders([path], recipe("proposal").train, views="outer_star")
        >>> scenes[0].name, scenes[0].sample.views.shape
        ('cotton', (1, 9, 256, 256))
    """
    selection = task_of(config.network).view_selection(views)
    scenes = []
    for folder in folders:
        light_field = load(folder, check_orientation=False)
        truth = light_field.ground_truth
        if truth is None:
            raise InputError(
                f"{folder}: has no ground truth to validate with; choose another scene"
            )
        offsets = light_field.positions
        sample = numpy_sample(
            light_field.grey(),
            view_offsets(*light_field.grid) if offsets is None else offsets,
            truth.astype(np.float32),
            valid=np.isfinite(truth),
        )
        try:
            sample = select_views(sample, selection)
        except InputError as error:
            raise InputError(f"{folder}: {error}") from error
        scenes.append(ValidationScene(light_field.name, to_device(sample)))
    return _with_unique_names(scenes)


def scenes_from_batch(batch: LightFieldSample, name: str = "sample") -> list[ValidationScene]:
    """Return the samples of a batch as scenes.

    Args:
        batch: Samples with a leading axis on every field.
        name: Name of the scenes; each gets a number after it.

    Returns:
        One scene for each sample.

    Example:
        >>> images = np.zeros((2, 3, 3, 4, 6), np.float32)
        >>> batch = numpy_sample(images, np.zeros((2, 3, 3, 2), np.float32), images[:, 1, 1])
        >>> [scene.name for scene in scenes_from_batch(batch)]
        ['sample_0', 'sample_1']
    """
    return [
        ValidationScene(f"{name}_{index}", jax.tree.map(lambda field, i=index: field[i], batch))
        for index in range(len(batch.views))
    ]


def check_scenes(scenes: Sequence[ValidationScene], *, border: int) -> None:
    """Check before training that every scene has pixels to compare.

    Args:
        scenes: The scenes.
        border: Pixels left out at each side.

    Raises:
        InputError: If a scene has no pixel with ground truth inside the border.
    """
    for scene in scenes:
        valid = np.asarray(scene.sample.valid)
        h, w = valid.shape
        if not valid[border : h - border, border : w - border].any():
            raise InputError(
                f"{scene.name}: no pixel of its {h}x{w} has ground truth and is at least "
                f"{border} pixels from the border; pass a smaller validation_border or leave it out"
            )


def picture(disparity: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Draw truth, estimate and error next to each other.

    Truth and estimate have the colours of the truth's range. The error is blue where the estimate
    is too far and red where it is too near, with full colours at bad pixels.

    Args:
        disparity: ``[h, w]`` estimate, pixels per view step.
        truth: ``[h, w]`` ground truth, NaN where it is unknown.

    Returns:
        ``[h, 3 w, 3]`` uint8 image.
    """
    norm = limits(truth)
    maps = [disparity_colours()(np.ma.masked_invalid(norm(image))) for image in (truth, disparity)]
    error = np.clip(disparity - truth, -ERROR_LIMIT, ERROR_LIMIT)
    colours = error_colours(BAD_PIXEL_THRESHOLD, ERROR_LIMIT)
    maps.append(colours(np.ma.masked_invalid(error / (2.0 * ERROR_LIMIT) + 0.5)))
    return np.round(255.0 * np.concatenate(maps, axis=1)[..., :3]).astype(np.uint8)


def _with_unique_names(scenes: list[ValidationScene]) -> list[ValidationScene]:
    """Number scenes of equal names; otherwise they would write the same picture."""
    count: Counter[str] = Counter()
    unique = []
    for name, sample in scenes:
        count[name] += 1
        numbered = name if count[name] == 1 else f"{name}_{count[name]}"
        unique.append(ValidationScene(numbered, sample))
    return unique
