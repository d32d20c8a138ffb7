"""Scores and pictures on light fields that training never sees."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import imageio.v3 as imageio
import jax
import jax.numpy as jnp
import numpy as np

from occjax.data.samples import Sample
from occjax.data.views import Selection, select_views
from occjax.errors import InputError
from occjax.evaluation import THRESHOLDS, Metrics, evaluate
from occjax.inference.network import infer
from occjax.io import load
from occjax.io.atomic import atomic_path
from occjax.ops import view_offsets
from occjax.training.config import TrainConfig
from occjax.training.step import network_inputs
from occjax.viz.colour import disparity_colours, error_colours, limits

SCORE = f"badpix_{THRESHOLDS[0]:g}"
"""The measure by which the best checkpoint is chosen: its mean over the scenes."""

ERROR_LIMIT = 0.3
"""Error at which the colours of the error map end, pixels per view step."""


class Scene(NamedTuple):
    """A light field with ground truth.

    Attributes:
        name: Of its picture and its lines in the log.
        sample: Without a batch axis.
    """

    name: str
    sample: Sample


def validate(
    variables: dict,
    scenes: Sequence[Scene],
    config: TrainConfig,
    *,
    border: int,
    pictures: Path | None = None,
) -> dict[str, float]:
    """Scores of a network on each scene, and their means.

    Args:
        variables: Of the network.
        scenes: One or more.
        config: The training.
        border: Pixels left out at each side.
        pictures: Folder for one picture of each scene: truth, estimate and error side by side.

    Returns:
        ``mse_x100``, ``badpix_0.07``, ``badpix_0.03`` and ``badpix_0.01``, the means over the
        scenes, and the same of each scene as ``<scene>/<measure>``.
    """
    return score_scenes(
        lambda sample: np.asarray(predict(variables, sample, config)),
        scenes,
        border=border,
        pictures=pictures,
    )


def score_scenes(
    estimate: Callable[[Sample], np.ndarray],
    scenes: Sequence[Scene],
    *,
    border: int,
    pictures: Path | None = None,
) -> dict[str, float]:
    """Scores of any estimate on each scene, and their means.

    Args:
        estimate: Gives the disparity ``[h, w]`` of a sample.
        scenes: One or more.
        border: Pixels left out at each side.
        pictures: Folder for one picture of each scene: truth, estimate and error side by side.

    Returns:
        As of :func:`validate`.
    """
    scores: dict[str, float] = {}
    for scene in scenes:
        disparity = estimate(scene.sample)
        truth, valid = np.asarray(scene.sample.disparity), np.asarray(scene.sample.valid)
        metrics = evaluate(disparity, truth, border=border, mask=valid)
        for name, value in _by_name(metrics).items():
            scores[f"{scene.name}/{name}"] = value
            scores[name] = scores.get(name, 0.0) + value / len(scenes)
        if pictures is not None:
            with atomic_path(pictures / f"{scene.name}.png") as path:
                imageio.imwrite(path, picture(disparity, np.where(valid, truth, np.nan)))
    return scores


@partial(jax.jit, static_argnames="config")
def predict(variables: dict, sample: Sample, config: TrainConfig) -> jax.Array:
    """Disparity ``[h, w]`` of one light field of any size, as inference computes it."""
    network, dtype = config.network, jnp.dtype(config.precision)
    inputs = network_inputs(network, sample)
    return infer(variables, sample.views, network, dtype=dtype, **inputs)[-1].disparity


def scenes_from_folders(
    folders: Sequence[str | Path], config: TrainConfig, *, views: Selection = "all"
) -> list[Scene]:
    """Light fields with ground truth, as the network takes them.

    Args:
        folders: Anything :func:`occjax.load` reads.
        config: The training.
        views: Which views are used, if the network takes any arrangement of them.

    Returns:
        The scenes, named after their folders.

    Raises:
        InputError: If one cannot be read, has no ground truth, or fewer views than the network
            takes.
    """
    scenes = []
    for folder in folders:
        light_field = load(folder, check_orientation=False)
        truth = light_field.ground_truth
        if truth is None:
            raise InputError(
                f"{folder}: has no ground truth to validate with; choose another scene"
            )
        if config.network.views is not None:
            light_field = light_field.central(*config.network.views)
        offsets, grey = light_field.positions, light_field.grey()
        sample = Sample(
            views=jnp.asarray(grey),
            offsets=view_offsets(*light_field.grid) if offsets is None else jnp.asarray(offsets),
            disparity=jnp.asarray(truth, jnp.float32),
            visibility=jnp.ones(grey.shape, bool),
            valid=jnp.asarray(np.isfinite(truth)),
        )
        if config.network.views is None:
            sample = select_views(sample, views)
        scenes.append(Scene(light_field.name, sample))
    return _with_unique_names(scenes)


def scenes_from_batch(batch: Sample, name: str = "sample") -> list[Scene]:
    """The examples of a batch as scenes.

    Args:
        batch: Examples, with a leading axis on every field.
        name: Of the scenes, before their number.

    Returns:
        One scene for each.
    """
    count = batch.views.shape[0]
    return [
        Scene(f"{name}_{index}", jax.tree.map(lambda field, index=index: field[index], batch))
        for index in range(count)
    ]


def check_scenes(scenes: Sequence[Scene], *, border: int) -> None:
    """Find out before training whether there is anything to compare within the border.

    Args:
        scenes: The scenes.
        border: Pixels left out at each side.

    Raises:
        InputError: Naming the first scene in which there is not.
    """
    for scene in scenes:
        valid = np.asarray(scene.sample.valid)
        h, w = valid.shape
        if not valid[border : h - border, border : w - border].any():
            raise InputError(
                f"{scene.name}: no pixel with ground truth lies {border} pixels inside its "
                f"{h}x{w}; pass a smaller validation_border or leave it out"
            )


def picture(disparity: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Truth, estimate and error side by side.

    The first two in the colours of the truth's range; the error blue where the estimate is too far
    and red where it is too near, in full colours where a pixel is bad.

    Args:
        disparity: ``[h, w]`` estimate.
        truth: ``[h, w]``, NaN where it is not known.

    Returns:
        ``[h, 3 w, 3]`` uint8.
    """
    norm = limits(truth)
    maps = [disparity_colours()(np.ma.masked_invalid(norm(image))) for image in (truth, disparity)]
    error = np.clip(disparity - truth, -ERROR_LIMIT, ERROR_LIMIT)
    colours = error_colours(THRESHOLDS[0], ERROR_LIMIT)
    maps.append(colours(np.ma.masked_invalid(error / (2.0 * ERROR_LIMIT) + 0.5)))
    return np.round(255.0 * np.concatenate(maps, axis=1)[..., :3]).astype(np.uint8)


def _by_name(metrics: Metrics) -> dict[str, float]:
    percentages = {f"badpix_{threshold:g}": value for threshold, value in metrics.badpix.items()}
    return {"mse_x100": metrics.mse_x100, **percentages}


def _with_unique_names(scenes: list[Scene]) -> list[Scene]:
    """Two folders of the same name would write the same picture."""
    names: dict[str, int] = {}
    unique = []
    for scene in scenes:
        names[scene.name] = number = names.get(scene.name, 0) + 1
        unique.append(scene if number == 1 else scene._replace(name=f"{scene.name}_{number}"))
    return unique
