"""From a light field to an estimate: choose the model, fit the light field to it, compile, run."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np

from occjax.errors import InputError
from occjax.inference.network import infer
from occjax.inference.photometric import PhotometricConfig, photometric
from occjax.inference.result import Estimate
from occjax.io import check
from occjax.lightfield import LightField
from occjax.models import PRESETS, NetworkConfig, preset
from occjax.models.config import Warp
from occjax.models.weights import load_weights
from occjax.ops import confidence

Precision = Literal["float32", "bfloat16"]
Say = Callable[[str], None]

PHOTOMETRIC = "photometric"
INTERVAL = 0.1
"""Spacing of the photometric candidates, in pixels per view step."""
MOST_CANDIDATES = 1024
"""A range that needs more is a mistake: the scene would move by hundreds of pixels."""
MODELS = (PHOTOMETRIC, *PRESETS)


def estimate(
    light_field: LightField,
    *,
    model: str | None = None,
    weights: str | Path | None = None,
    warp: Warp | None = None,
    disparity_range: tuple[float, float] | None = None,
    precision: str = "float32",
) -> Estimate:
    """Estimate the disparity of a light field's centre view.

    Compiled once per shape. For several light fields make one :class:`Estimator`, which also reads
    its weights only once.

    Args:
        light_field: Views and what is known about them, see :func:`occjax.load`.
        model: ``"photometric"`` (training-free, any grid) or a network's preset. By default the one
            the weights were made for, or photometric without weights.
        weights: File of the network's weights, ``.safetensors`` or the published ``.h5``/``.hdf5``.
        warp: ``"correct"`` or ``"transposed"``, in place of what the weights were trained with.
        disparity_range: ``(minimum, maximum)`` to search, in pixels per view step. By default what
            the light field says, else what its photo-consistency shows.
        precision: Type of a network's convolutions, ``"float32"`` or ``"bfloat16"``.

    Returns:
        The estimate, as NumPy arrays.

    Raises:
        InputError: If model, weights, range and light field do not fit together.

    Example:
        >>> from occjax.data.sample import sample
        >>> result = estimate(sample().central(3, 3), disparity_range=(-1.0, 1.0))
        >>> result.disparity.shape == sample().image_size
        True
    """
    estimator = Estimator(model, weights=weights, warp=warp, precision=precision)
    return estimator(light_field, disparity_range=disparity_range)


class Estimator:
    """A model with its weights, compiled once per shape of light field.

    Attributes:
        model: Name of the model.
        weights: Name of the weights' file, None for the photometric estimator.
        config: Its configuration.
        notes: What the user should know about the choice of model and weights.
    """

    def __init__(
        self,
        model: str | None = None,
        *,
        weights: str | Path | None = None,
        warp: Warp | None = None,
        precision: str = "float32",
    ) -> None:
        if model is not None and model not in MODELS:
            raise InputError(f"there is no model named {model!r}; there are {', '.join(MODELS)}")
        if precision not in get_args(Precision):
            raise InputError(f"precision is {' or '.join(get_args(Precision))}, not {precision!r}")
        self.notes: tuple[str, ...] = ()
        self.weights: str | None = None
        self.config: PhotometricConfig | NetworkConfig
        if weights is None and model in (None, PHOTOMETRIC):
            if warp is not None or precision != "float32":
                raise InputError(
                    "the photometric estimator has no warp and computes in float32; "
                    "leave out warp (--warp) and precision (--precision)"
                )
            self.model, self.config = PHOTOMETRIC, PhotometricConfig()
            self._run = partial(_compiled, _run_photometric, config=self.config)
        elif model == PHOTOMETRIC:
            raise InputError(f"the photometric estimator takes no weights; leave out {weights}")
        elif weights is None:
            raise InputError(
                f"the network {model} needs weights: pass a file (--weights FILE), or fetch the "
                "published ones of occcasnet with 'occjax weights fetch'"
            )
        else:
            expected = None if model is None else preset(model)
            self._variables, self.config = load_weights(weights, expected, warp=warp)
            self.model = model or _name_of(self.config)
            self.weights = Path(weights).name
            if self.config.warp == "transposed":
                self.notes = (
                    "warp: transposed, as the published code trained it (rows move with u); "
                    "choose --warp correct to override",
                )
            self._run = partial(_compiled, _run_network, config=self.config, dtype=precision)

    def __call__(
        self,
        light_field: LightField,
        *,
        disparity_range: tuple[float, float] | None = None,
        say: Say = lambda phase: None,
    ) -> Estimate:
        """Estimate one light field.

        Args:
            light_field: Views and what is known about them.
            disparity_range: ``(minimum, maximum)`` to search, in pixels per view step.
            say: Called with the name of each phase as it begins.

        Returns:
            The estimate.

        Raises:
            InputError: If the light field does not fit the model, or the range is none.
        """
        if disparity_range is not None:
            _check_range(disparity_range)
        prepare = self._prepare_photometric
        if isinstance(self.config, NetworkConfig):
            prepare = self._prepare_network
        arguments, searched, notes = prepare(light_field, disparity_range)

        seconds = {}
        say("compiling")
        begin = time.perf_counter()
        leaves, structure = jax.tree.flatten(arguments)
        shapes = tuple(jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) for leaf in leaves)
        compiled = self._run(structure, shapes)
        seconds["compile"] = time.perf_counter() - begin
        say("estimating")
        begin = time.perf_counter()
        result = jax.tree.map(np.asarray, jax.block_until_ready(compiled(*arguments)))
        seconds["run"] = time.perf_counter() - begin
        return Estimate(
            **result,
            disparity_range=searched,
            model=self.model,
            weights=self.weights,
            notes=(*self.notes, *notes),
            seconds=seconds,
        )

    def _prepare_photometric(self, light_field, disparity_range):
        (low, high), notes = _choose_range(light_field, disparity_range)
        if (high - low) / INTERVAL > MOST_CANDIDATES:
            raise InputError(
                f"{light_field.name}: the disparity range [{low:g}, {high:g}] is too wide; "
                f"at most {MOST_CANDIDATES * INTERVAL:g} pixels per view step can be searched"
            )
        # A multiple of eight candidates: scenes of similar range then share a compilation.
        number = 8 * int(np.ceil(((high - low) / INTERVAL + 1) / 8))
        candidates = np.linspace(low, high, number, dtype=np.float32)
        offsets = light_field.positions
        if offsets is not None:
            offsets = np.asarray(offsets, np.float32)
        return (light_field.floating(), candidates, offsets), (low, high), notes

    def _prepare_network(self, light_field, disparity_range):
        config, notes = self.config, []
        light_field, cropped = _crop(light_field, config.views)
        notes += cropped
        if light_field.positions is not None:
            notes.append("the views' irregular positions are ignored: the network assumes a grid")
        candidates = np.asarray(config.stages[0].candidates, np.float32)
        wanted = disparity_range or light_field.disparity_range
        covered = (float(candidates[0]), float(candidates[-1]))
        if wanted is not None and not (covered[0] <= wanted[0] and wanted[1] <= covered[1]):
            candidates = candidates + np.float32((sum(wanted) - sum(covered)) / 2)
            covered = (float(candidates[0]), float(candidates[-1]))
            notes.append(f"candidates moved to [{covered[0]:.2f}, {covered[1]:.2f}]")
        if wanted is not None and wanted[1] - wanted[0] > covered[1] - covered[0] + 1e-6:
            message = (
                f"the network covers {covered[1] - covered[0]:g} pixels of disparity, less than "
                f"the range [{wanted[0]:g}, {wanted[1]:g}]"
            )
            if disparity_range is not None:
                raise InputError(f"{message}; the photometric model takes any range")
            notes.append(message)
        truth = None
        if any(stage.occlusion == "ground_truth" for stage in config.stages):
            truth = light_field.ground_truth
            if truth is None:
                raise InputError(
                    f"{light_field.name}: {self.model} takes occlusion maps from the ground truth, "
                    "and there is none"
                )
        return (self._variables, light_field.grey(), candidates, truth), covered, notes


@functools.lru_cache(maxsize=64)
def _compiled(run: Callable, structure: Any, shapes: tuple, **static: Any) -> Callable:
    """A function compiled for arguments of these shapes; shared by all estimators."""
    arguments = jax.tree.unflatten(structure, shapes)
    return jax.jit(run, static_argnames=tuple(static)).lower(*arguments, **static).compile()


def _run_photometric(views, candidates, offsets, *, config):
    return photometric(views, candidates, offsets=offsets, config=config)._asdict()


def _run_network(variables, views, candidates, ground_truth, *, config, dtype):
    stages = infer(
        variables,
        views,
        config,
        candidates=candidates,
        ground_truth=ground_truth,
        dtype=jnp.dtype(dtype),
    )
    readings = [confidence(stage.probabilities, stage.candidates) for stage in stages]
    # A refined stage cannot know that the stage before chose the wrong surface: the least certain
    # stage speaks for all.
    certainty = [
        reading.certainty(len(stage.candidates))
        for reading, stage in zip(readings, stages, strict=True)
    ]
    return {
        "disparity": stages[-1].disparity,
        "confidence": jnp.stack(certainty).min(0),
        "standard_deviation": readings[-1].standard_deviation,
        "coarse": stages[0].disparity if len(stages) > 1 else None,
        "occlusion": stages[-1].occlusion,
    }


def _choose_range(
    light_field: LightField, asked: tuple[float, float] | None
) -> tuple[tuple[float, float], list[str]]:
    if asked is not None:
        return (float(asked[0]), float(asked[1])), []
    if light_field.disparity_range is not None:
        return light_field.disparity_range, []
    report = check(light_field)
    low, high = report.disparity_range
    if not report.measured:
        note = (
            f"no texture to measure the disparity range from; [{low:.2f}, {high:.2f}] is searched"
        )
    else:
        note = (
            f"disparity range [{low:.2f}, {high:.2f}] found by photo-consistency in "
            f"{report.measured:.0%} of the pixels"
        )
    return (low, high), [note]


def _check_range(disparity_range: tuple[float, float]) -> None:
    low, high = disparity_range
    if not (np.isfinite([low, high]).all() and low + 1e-3 <= high):
        raise InputError(f"the disparity range needs minimum < maximum, not {low} {high}")


def _crop(light_field: LightField, views: tuple[int, int]) -> tuple[LightField, list[str]]:
    """The central views a network takes."""
    grid = light_field.grid
    if grid == views:
        return light_field, []
    if grid[0] < views[0] or grid[1] < views[1]:
        fitting = [
            name
            for name, config in PRESETS.items()
            if config.views[0] <= grid[0] and config.views[1] <= grid[1]
        ]
        raise InputError(
            f"{light_field.name}: has {grid[0]}x{grid[1]} views, the network takes "
            f"{views[0]}x{views[1]}; use one of {', '.join((PHOTOMETRIC, *fitting))}"
        )
    note = f"the central {views[0]}x{views[1]} of {grid[0]}x{grid[1]} views are used"
    return light_field.central(*views), [note]


def _name_of(config: NetworkConfig) -> str:
    """The preset a network is, whichever warp it uses."""
    for name in PRESETS:
        if preset(name, warp=config.warp) == config:
            return name
    return "custom"
