"""From a light field to an estimate: choose the model, fit the light field to it, compile, run."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, get_args

import jax
import jax.export
import jax.numpy as jnp
import numpy as np

from occjax.errors import InputError
from occjax.inference.network import infer
from occjax.inference.photometric import PhotometricConfig, photometric
from occjax.inference.preparation import (
    Ready,
    check_range,
    for_any_views,
    for_grid,
    for_photometric,
)
from occjax.inference.result import Estimate
from occjax.lightfield import LightField
from occjax.models import PRESETS, NetworkConfig, StageOutput, preset
from occjax.models.bundled import bundled_weights, find_weights
from occjax.models.config import Warp
from occjax.models.weights import load_weights
from occjax.ops import confidence, occlusion_maps, probability_near

Precision = Literal["float32", "bfloat16"]
Say = Callable[[str], None]

SAME_SURFACE = 0.15
"""Proposals this near to what was chosen among them speak for it, pixels per view step."""

PHOTOMETRIC = "photometric"
MODELS = (PHOTOMETRIC, *PRESETS)

AT_THE_END, MANY_AT_THE_END = 0.001, 0.1
"""How near an end of the searched range, as a share of it, a disparity lies there; share of the
pixels from which the user is told. Right ranges have 0.003 at most, wrong ones 0.12 and more.
"""


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
            the weights were made for.
        weights: File of the network's weights, ``.safetensors`` or the published ``.h5``/``.hdf5``,
            or the name of those in the package (``occjax weights list``). By default those of this
            name, without a model the first in the list.
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
        self._variables: dict = {}
        self._run: Callable[..., dict]
        self._settings: dict[str, Any]
        self.config: PhotometricConfig | NetworkConfig
        if weights is None:
            weights = _bundled_for(model)
        if weights is None and model in (None, PHOTOMETRIC):
            if warp is not None or precision != "float32":
                raise InputError(
                    "the photometric estimator has no warp and computes in float32; "
                    "leave out warp (--warp) and precision (--precision)"
                )
            self.model, self.config = PHOTOMETRIC, PhotometricConfig()
            self._run, self._settings = _run_photometric, {"config": self.config}
        elif model == PHOTOMETRIC:
            raise InputError(f"the photometric estimator takes no weights; leave out {weights}")
        elif weights is None:
            raise InputError(
                f"the network {model} needs weights: pass a file (--weights FILE), or fetch the "
                "published ones of occcasnet with 'occjax weights fetch'"
            )
        else:
            expected = None if model is None else preset(model)
            weights = find_weights(weights)
            self._variables, self.config = load_weights(weights, expected, warp=warp)
            self.model = model or _name_of(self.config)
            self.weights = Path(weights).name
            if self.config.warp == "transposed":
                self.notes = (
                    "warp: transposed, as the published code trained it (rows move with u); "
                    "choose --warp correct to override",
                )
            self._run = _run_network if self.config.views else _run_on_some_views
            self._settings = {"config": self.config, "dtype": precision}

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
        ready = self._ready(light_field, disparity_range)
        arguments = (self._variables, *ready.arguments)
        seconds = {}
        say("compiling")
        begin = time.perf_counter()
        leaves, structure = jax.tree.flatten(arguments)
        shapes = tuple(jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) for leaf in leaves)
        compiled = _compiled(self._run, structure, shapes, **self._settings)
        seconds["compile"] = time.perf_counter() - begin
        say("estimating")
        begin = time.perf_counter()
        result = jax.tree.map(np.asarray, jax.block_until_ready(compiled(*arguments)))
        seconds["run"] = time.perf_counter() - begin
        # Not by lambdas: an estimate can be pickled.
        find_occlusion: Callable[[], np.ndarray] | None
        if "occlusion" in result:
            maps = result.pop("occlusion")
            find_occlusion = None if maps is None else functools.partial(np.asarray, maps)
        else:
            find_occlusion = functools.partial(_occlusion, light_field, result["disparity"])
        notes = (*self.notes, *ready.notes, *_at_the_ends(result["disparity"], ready.searched))
        return Estimate(
            **result,
            find_occlusion=find_occlusion,
            disparity_range=ready.searched,
            model=self.model,
            weights=self.weights,
            notes=notes,
            seconds=seconds,
        )

    def export(
        self,
        light_field: LightField,
        *,
        disparity_range: tuple[float, float] | None = None,
        platforms: tuple[str, ...] | None = None,
    ) -> jax.export.Exported:
        """The compiled estimator as portable StableHLO, weights and candidates inside.

        It runs without occjax and without Python's part of the network, wherever StableHLO runs.
        Write ``exported.serialize()`` to a file (extra ``export``), and call
        ``jax.export.deserialize(data).call(views)``. The views are float32 in [0, 1]: grey
        ``[v, u, h, w]`` for a network, ``[v, u, h, w, c]`` for the photometric estimator.

        Args:
            light_field: One of the shape and the arrangement of views to export for.
            disparity_range: ``(minimum, maximum)`` to search; as for a call by default.
            platforms: Where it shall run, for instance ``("cpu", "cuda")``; here by default.

        Returns:
            What gives a dictionary of ``disparity``, ``confidence`` and the other maps of
            :class:`Estimate`; occlusion maps only of a network that looks at them itself.

        Raises:
            InputError: As a call does.

        Example:
            >>> from occjax.data.sample import sample
            >>> light_field = sample().central(3, 3)
            >>> exported = Estimator().export(light_field, disparity_range=(-1.0, 1.0))
            >>> [shape.shape for shape in exported.in_avals]
            [(3, 3, 256, 256)]
        """
        ready = self._ready(light_field, disparity_range)
        views, *others = jax.tree.map(jnp.asarray, ready.arguments)
        looked_at = ready.looked_at
        grid = views.shape[:2] if looked_at is None else light_field.grid

        def run(views):
            if looked_at is not None:
                views = views.reshape(1, -1, *views.shape[2:])[:, looked_at]
            return self._run(self._variables, views, *others, **self._settings)

        shape = jax.ShapeDtypeStruct((*grid, *views.shape[2:]), views.dtype)
        return jax.export.export(jax.jit(run), platforms=platforms)(shape)

    def _ready(self, light_field: LightField, disparity_range: tuple[float, float] | None) -> Ready:
        if disparity_range is not None:
            check_range(disparity_range)
        if isinstance(self.config, PhotometricConfig):
            return for_photometric(light_field, disparity_range)
        if self.config.views is None:
            return for_any_views(light_field, disparity_range, self.config)
        return for_grid(light_field, disparity_range, self.config)


def _at_the_ends(disparity: np.ndarray, searched: tuple[float, float]) -> list[str]:
    """What to tell the user if disparities pile up where the search ended."""
    low, high = searched
    close = AT_THE_END * (high - low)
    notes = []
    for end, share in (
        ("lower", float(np.mean(disparity <= low + close))),
        ("upper", float(np.mean(disparity >= high - close))),
    ):
        if share > MANY_AT_THE_END:
            notes.append(
                f"{share:.0%} of the disparities lie at the {end} end of the searched range "
                f"[{low:.2f}, {high:.2f}]: the scene goes beyond it, it seems; pass a wider "
                "disparity_range (--disparity-range)"
            )
    return notes


def _bundled_for(model: str | None) -> Path | None:
    """Weights in the package for a model; the default ones if it may be any."""
    for weights in bundled_weights():
        if model in (None, weights.name):
            weights.verify()
            return weights.path
    return None


@functools.lru_cache(maxsize=64)
def _compiled(run: Callable, structure: Any, shapes: tuple, **static: Any) -> Callable:
    """A function compiled for arguments of these shapes; shared by all estimators."""
    arguments = jax.tree.unflatten(structure, shapes)
    compiled = jax.jit(run, static_argnames=tuple(static)).lower(*arguments, **static).compile()
    _return_memory()
    return compiled


def _return_memory() -> None:
    """Give what the compiler has freed, half a gigabyte, back before the arrays need as much.

    The C library keeps it otherwise. That of most Linux systems can be told not to.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


def _occlusion(light_field: LightField, disparity: np.ndarray) -> np.ndarray:
    """Occlusion maps of all views, where no network needs them for itself."""
    maps = jax.jit(occlusion_maps)(
        light_field.grey()[..., None], disparity, offsets=light_field.positions
    )
    return np.asarray(maps)


def _run_photometric(_, views, candidates, offsets, *, config):
    result = photometric(views, candidates, offsets=offsets, config=config)._asdict()
    del result["occlusion"]
    return {**result, "stages": (result["coarse"], result["disparity"])}


def _run_network(variables, views, candidates, ground_truth, *, config, dtype):
    stages = infer(
        variables,
        views,
        config,
        candidates=candidates,
        ground_truth=ground_truth,
        dtype=jnp.dtype(dtype),
    )
    return {**_maps(stages), "occlusion": stages[-1].occlusion}


def _run_on_some_views(variables, views, candidates, offsets, bounds, *, config, dtype):
    stages = infer(
        variables,
        views,
        config,
        candidates=candidates,
        offsets=offsets,
        dtype=jnp.dtype(dtype),
    )
    last = stages[-1]._replace(disparity=jnp.clip(stages[-1].disparity, bounds[0], bounds[1]))
    stages = (*stages[:-1], last)
    maps = _maps(stages)
    # The last output is the median of the one before it: no stage of its own.
    return {**maps, "stages": (*maps["stages"][:-2], last.disparity)}


def _maps(stages: tuple[StageOutput, ...]) -> dict:
    """What an estimate has, of a network's stages."""
    disparity = stages[-1].disparity
    certainty, deviation = [], None
    for before, stage in zip((None, *stages), stages, strict=False):
        if stage.probabilities is None or stage.candidates is None:
            continue
        reading = confidence(stage.probabilities, stage.candidates)
        deviation = reading.standard_deviation
        if before is None or stage.candidates.ndim == 1:
            certainty.append(reading.certainty(len(stage.candidates)))
        else:
            chosen = stage.disparity - before.disparity
            certainty.append(
                probability_near(stage.probabilities, stage.candidates, chosen, SAME_SURFACE)
            )
    return {
        "disparity": disparity,
        # A refined stage cannot know that the stage before chose the wrong surface: the least
        # certain stage speaks for all.
        "confidence": jnp.stack(certainty).min(0),
        "standard_deviation": deviation,
        "coarse": stages[0].disparity if len(stages) > 1 else None,
        "stages": tuple(stage.disparity for stage in stages),
    }


def _name_of(config: NetworkConfig) -> str:
    """The preset a network is, whichever warp it uses."""
    for name, known in PRESETS.items():
        if known == dataclasses.replace(config, warp=known.warp):
            return name
    return "custom"
