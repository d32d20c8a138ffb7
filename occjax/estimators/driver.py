"""Run an estimator on a light field: prepare, compile once per shape, run, finish."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import platformdirs
from jax.experimental.compilation_cache import compilation_cache
from numpy.typing import ArrayLike

from occjax.errors import InputError
from occjax.estimators.factory import make_estimator
from occjax.estimators.protocol import DisparityRange, Estimate, Estimator
from occjax.layout import registered
from occjax.lightfield import LightField
from occjax.models.occcasnet.config import Warp
from occjax.ops import occlusion_maps

ReportPhase = Callable[[str], None]
"""Function that is called with the name of each phase when it begins."""


def estimate(
    light_field: LightField | ArrayLike,
    *,
    model: str | Estimator | None = None,
    weights: str | Path | None = None,
    warp: Warp | None = None,
    disparity_range: DisparityRange | None = None,
    precision: str = "float32",
    occlusion: bool = False,
) -> Estimate:
    """Estimate the disparity of a light field's centre view.

    The program is compiled once per shape. For several light fields, create the estimator once with
    :func:`make_estimator` and call :func:`run_estimator`, which reads the weights only once.

    Args:
        light_field: Light field, see :func:`occjax.load`, or its views ``[V, U, H, W, C]``, see
            :class:`LightField`.
        model: Name of a model, see :func:`make_estimator`, or any :class:`Estimator`.
        weights: Weights, see :func:`make_estimator`.
        warp: Warp, see :func:`make_estimator`.
        disparity_range: ``(minimum, maximum)`` to search, in pixels per view step. By default the
            range of the light field; if it has none, the range is measured.
        precision: Type of a network's convolutions, ``"float32"`` or ``"bfloat16"``.
        occlusion: Whether to compute the occlusion map of every view.

    Returns:
        The estimate, as NumPy arrays.

    Raises:
        InputError: If model, weights, range and light field do not fit together, or if the light
            field is a path.

    Example:
        >>> from occjax.data.bundled_sample import sample
        >>> result = estimate(sample().central(3, 3), disparity_range=(-1.0, 1.0))
        >>> result.disparity.shape == sample().image_size
        True
    """
    if isinstance(light_field, str | Path):
        raise InputError(f"{light_field} is a path; pass occjax.load({str(light_field)!r})")
    if not isinstance(light_field, LightField):
        light_field = LightField(np.asarray(light_field))
    if model is None or isinstance(model, str):
        model = make_estimator(model, weights=weights, warp=warp, precision=precision)
    return run_estimator(model, light_field, disparity_range=disparity_range, occlusion=occlusion)


def run_estimator(
    estimator: Estimator,
    light_field: LightField,
    *,
    disparity_range: DisparityRange | None = None,
    occlusion: bool = False,
    report_phase: ReportPhase = lambda phase: None,
) -> Estimate:
    """Estimate the disparity of a light field with a given estimator.

    Args:
        estimator: From :func:`make_estimator`, or any :class:`Estimator`.
        light_field: Light field.
        disparity_range: ``(minimum, maximum)`` to search, in pixels per view step.
        occlusion: Whether to compute the occlusion map of every view.
        report_phase: Function that is called with the name of each phase.

    Returns:
        The estimate; ``seconds`` has the phases ``prepare``, ``compile``, ``run`` and, if
        requested, ``occlusion``.

    Raises:
        InputError: If the light field does not fit the estimator, or the range is not a range.

    Example:
        >>> from occjax.data.bundled_sample import sample
        >>> light_field = sample().central(3, 3)
        >>> photometric = make_estimator("photometric")
        >>> result = run_estimator(photometric, light_field, disparity_range=(-1.0, 1.0))
        >>> sorted(result.seconds)
        ['compile', 'prepare', 'run']
    """
    seconds: dict[str, float] = {}

    @contextmanager
    def phase(name: str, description: str) -> Iterator[None]:
        report_phase(description)
        begin = time.perf_counter()
        yield
        seconds[name] = time.perf_counter() - begin

    with phase("prepare", "preparing"):
        light_field, corrections = registered(light_field)
        inputs = estimator.prepare(light_field, disparity_range)
        inputs = inputs._replace(notes=(*corrections, *inputs.notes))
        arguments = (inputs.variables, inputs.views, *inputs.others)
    with phase("compile", "compiling"):
        leaves, structure = jax.tree.flatten(arguments)
        shapes = tuple(jax.ShapeDtypeStruct(leaf.shape, leaf.dtype) for leaf in leaves)
        compiled = _compile(estimator, structure, shapes)
    with phase("run", "estimating"):
        outputs = jax.tree.map(np.asarray, jax.block_until_ready(compiled(*arguments)))
    result = estimator.finish(inputs, outputs)
    if occlusion and result.occlusion is None:
        with phase("occlusion", "occlusion maps"):
            maps = estimate_occlusion(light_field, result.disparity)
        result = dataclasses.replace(result, occlusion=maps)
    return dataclasses.replace(result, seconds=seconds)


def estimate_occlusion(light_field: LightField, disparity: np.ndarray) -> np.ndarray:
    """Compute the occlusion map of every view from a disparity map (OccCasNet, eqs. 4 and 5).

    Args:
        light_field: Light field.
        disparity: ``[H, W]`` disparity of the centre view, pixels per view step.

    Returns:
        ``[V, U, H, W]`` float32 in [0, 1]; 1 where a view does not see the point.

    Example:
        >>> light_field = LightField(np.ones((1, 3, 8, 8, 1), np.float32))
        >>> float(estimate_occlusion(light_field, np.zeros((8, 8), np.float32)).max())
        0.0
    """
    maps = _occlusion_maps(light_field.grey()[..., None], disparity, light_field.positions)
    return np.asarray(maps)


def export_estimator(
    estimator: Estimator,
    light_field: LightField,
    *,
    disparity_range: DisparityRange | None = None,
    platforms: tuple[str, ...] | None = None,
) -> jax.export.Exported:
    """Export the estimator as portable StableHLO with weights and candidates inside.

    The export runs without occjax, wherever StableHLO runs. Write ``exported.serialize()`` to a
    file (extra ``export``) and call ``jax.export.deserialize(data).call(views)`` with grey float32
    views ``[v, u, h, w]`` in [0, 1].

    Args:
        estimator: From :func:`make_estimator`.
        light_field: Light field of the shape and the arrangement of views to export for.
        disparity_range: ``(minimum, maximum)`` to search; by default as in :func:`estimate`.
        platforms: Platforms to export for, such as ``("cpu", "cuda")``; by default the current one.

    Returns:
        Function of the views that returns a dictionary with ``disparity``, ``confidence`` and the
        other maps of :class:`Estimate`.

    Raises:
        InputError: If the light field does not fit the estimator.

    Example:
        >>> from occjax.data.bundled_sample import sample
        >>> light_field = sample().central(3, 3)
        >>> photometric = make_estimator("photometric")
        >>> exported = export_estimator(photometric, light_field, disparity_range=(-1.0, 1.0))
        >>> [shape.shape for shape in exported.in_avals]
        [(3, 3, 256, 256)]
    """
    inputs = estimator.prepare(registered(light_field)[0], disparity_range)
    others = jax.tree.map(jnp.asarray, inputs.others)
    indices, image_shape = inputs.view_indices, inputs.views.shape[2:]

    def run(views):
        if indices is not None:
            views = views.reshape(1, -1, *image_shape)[:, indices]
        return estimator.run(inputs.variables, views, *others)

    grid = inputs.views.shape[:2] if indices is None else light_field.grid
    shape = jax.ShapeDtypeStruct((*grid, *image_shape), inputs.views.dtype)
    return jax.export.export(jax.jit(run), platforms=platforms)(shape)


@functools.lru_cache(maxsize=64)
def _compile(estimator: Any, structure: Any, shapes: tuple) -> Callable:
    """Compile an estimator for arguments of these shapes."""
    _enable_compilation_cache()
    arguments = jax.tree.unflatten(structure, shapes)
    compiled = jax.jit(estimator.run).lower(*arguments).compile()
    _release_memory()
    return compiled


def _enable_compilation_cache() -> None:
    """Keep compiled programs in the user's cache folder, unless the user configured another one."""
    if getattr(jax.config, "jax_compilation_cache_dir", None) is None:
        folder = Path(platformdirs.user_cache_dir("occjax")) / "xla"
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
        # JAX decides at the first compilation of a process whether there is a cache.
        compilation_cache.reset_cache()


@jax.jit
def _occlusion_maps(views, disparity, offsets):
    return occlusion_maps(views, disparity, offsets=offsets)


def _release_memory() -> None:
    """Return the memory that the compiler has freed, about 0.5 GB, to the system.

    The C library of most Linux systems keeps it unless ``malloc_trim`` is called.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)
