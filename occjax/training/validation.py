"""Scores and pictures of light fields that training does not use.

A light field is estimated and compared as ``occjax estimate`` does it, with the same code: the same
views, disparity range, precision and border. The scores of a weights file are therefore those that
``occjax estimate --weights`` prints.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import jax
import numpy as np

from occjax.data.samples import LightFieldSample
from occjax.errors import InputError
from occjax.estimators import run_estimator
from occjax.estimators.factory import estimator_of
from occjax.evaluation.metrics import BAD_PIXEL_THRESHOLD, compare
from occjax.io import load
from occjax.lightfield import LightField, view_offsets
from occjax.models import ModelConfig
from occjax.viz.pictures import disparity_picture, error_picture, save_picture

SELECTION_METRIC = f"badpix_{BAD_PIXEL_THRESHOLD:g}"
"""Name of the score whose mean over the scenes selects the best checkpoint."""


def validate(
    variables: dict,
    scenes: Sequence[LightField],
    network: ModelConfig,
    *,
    pictures: Path | None = None,
) -> dict[str, float]:
    """Compute the scores of a model on each scene, and their means.

    Args:
        variables: Variables of the model.
        scenes: At least one light field with ground truth, with different names.
        network: Configuration of the model.
        pictures: Folder for one picture per scene: truth, estimate and error next to each other.

    Returns:
        ``mse_x100``, ``badpix_0.07``, ``badpix_0.03`` and ``badpix_0.01``, the means over the
        scenes, and the same for each scene as ``<scene>/<measure>``.

    Example:
        >>> from occjax.models import preset, variable_shapes
        >>> network = preset("tiny")
        >>> zeros = jax.tree.map(
        ...     lambda leaf: np.zeros(leaf.shape, leaf.dtype), variable_shapes(network)
        ... )
        >>> views = np.zeros((3, 3, 16, 16), np.float32)
        >>> flat = LightField(views, name="flat", ground_truth=views[1, 1])
        >>> scores = validate(zeros, [flat], network)
        >>> scores["badpix_0.07"] == scores["flat/badpix_0.07"]
        True
    """
    estimator = estimator_of(network, variables)
    return score_scenes(
        lambda light_field: run_estimator(estimator, light_field).disparity,
        scenes,
        pictures=pictures,
    )


def score_scenes(
    estimate: Callable[[LightField], np.ndarray],
    scenes: Sequence[LightField],
    *,
    pictures: Path | None = None,
) -> dict[str, float]:
    """Compute the scores of any estimator on each scene, and their means.

    Args:
        estimate: Function that returns the disparity ``[H, W]`` of a light field.
        scenes: At least one light field with ground truth, with different names.
        pictures: Folder for one picture per scene, see :func:`validate`.

    Returns:
        Scores with the names of :func:`validate`.
    """
    scores: dict[str, float] = {}
    for scene in scenes:
        name, truth = scene.name, scene.ground_truth
        disparity = estimate(scene)
        metrics = compare(disparity, truth)
        assert truth is not None
        assert metrics is not None
        badpix = {f"badpix_{threshold:g}": value for threshold, value in metrics.badpix.items()}
        for measure, value in {"mse_x100": metrics.mse_x100, **badpix}.items():
            scores[f"{name}/{measure}"] = value
            scores[measure] = scores.get(measure, 0.0) + value / len(scenes)
        if pictures is not None:
            save_picture(picture(disparity, truth), pictures / f"{name}.png")
    return scores


def scenes_from_folders(folders: Sequence[str | Path]) -> list[LightField]:
    """Read light fields with ground truth.

    Args:
        folders: Anything that :func:`occjax.load` reads.

    Returns:
        The light fields, with different names.

    Raises:
        InputError: If a light field cannot be read or has no ground truth.

    Example:
        >>> import tempfile
        >>> from occjax.io import write_arrays
        >>> views, truth = np.zeros((1, 1, 4, 6, 1), np.uint8), np.zeros((4, 6), np.float32)
        >>> path = Path(tempfile.mkdtemp()) / "cotton.npz"
        >>> write_arrays(path, LightField(views, ground_truth=truth))
        >>> scenes_from_folders([path])[0].name
        'cotton'
    """
    scenes: list[LightField] = []
    number_of: Counter[str] = Counter()
    for folder in folders:
        light_field = load(folder)
        if light_field.ground_truth is None:
            raise InputError(
                f"{folder}: has no ground truth to validate with; choose another scene"
            )
        # Scenes of equal names would write the same picture.
        name = light_field.name
        number_of[name] += 1
        if number_of[name] > 1:
            light_field = dataclasses.replace(light_field, name=f"{name}_{number_of[name]}")
        scenes.append(light_field)
    return scenes


def scenes_from_batch(
    batch: LightFieldSample,
    name: str = "sample",
    *,
    disparity_range: tuple[float, float] | None = None,
) -> list[LightField]:
    """Return the samples of a batch as light fields.

    Args:
        batch: Samples with a leading axis on every field.
        name: Name of the light fields; each gets a number after it.
        disparity_range: ``(minimum, maximum)`` of all samples, in pixels per view step, if known.

    Returns:
        One light field for each sample.

    Example:
        >>> from occjax.data.samples import numpy_sample
        >>> images = np.zeros((2, 3, 3, 4, 6), np.float32)
        >>> batch = numpy_sample(images, np.zeros((2, 3, 3, 2), np.float32), images[:, 1, 1])
        >>> [scene.name for scene in scenes_from_batch(batch)]
        ['sample_0', 'sample_1']
    """
    scenes = []
    for index in range(len(batch.views)):
        sample = jax.tree.map(lambda field, index=index: np.asarray(field[index]), batch)
        regular = np.array_equal(sample.offsets, view_offsets(*sample.views.shape[:2]))
        scenes.append(
            LightField(
                sample.views[..., None],
                name=f"{name}_{index}",
                disparity_range=disparity_range,
                ground_truth=np.where(sample.valid, sample.disparity, np.float32(np.nan)),
                positions=None if regular else sample.offsets,
            )
        )
    return scenes


def check_scenes(scenes: Sequence[LightField], network: ModelConfig) -> None:
    """Check before training that every scene can be estimated and compared.

    Raises:
        InputError: If a light field does not have the views that the model takes, or has no pixel
            with ground truth inside the border.
    """
    for scene in scenes:
        estimator_of(network, {}).prepare(scene, None)
        if compare(np.zeros(scene.image_size), scene.ground_truth) is None:
            raise InputError(
                f"{scene.name}: no pixel inside the border has ground truth; choose another scene"
            )


def picture(disparity: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Draw truth, estimate and error next to each other, in the colours of ``occjax estimate``.

    Args:
        disparity: ``[h, w]`` estimate, pixels per view step.
        truth: ``[h, w]`` ground truth, NaN where it is unknown.

    Returns:
        ``[h, 3 w, 3]`` uint8 image.
    """
    both = np.concatenate([truth, disparity], axis=1)  # one range of colours
    maps = disparity_picture(both, ground_truth=truth), error_picture(disparity, truth)
    return np.concatenate(maps, axis=1)
