"""Run an estimator on a light field: register, prepare, compile once per shape, run, finish."""

from __future__ import annotations

import dataclasses
import importlib.util
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.export import Exported, export
from numpy.typing import ArrayLike

from occjax import programs
from occjax.errors import InputError
from occjax.estimators.factory import make_estimator
from occjax.estimators.phases import Phase, ReportPhase
from occjax.estimators.protocol import DisparityRange, Estimate, Estimator
from occjax.estimators.ranges import notes_on_limits
from occjax.layout import check, registered
from occjax.lightfield import LightField
from occjax.models.occcasnet.config import Warp

MAX_LOADED_ESTIMATORS = 4
"""Compiled estimators, of different shapes, that a process keeps in memory for each device."""


def estimate(
    light_field: LightField | ArrayLike,
    *,
    model: str | Estimator | None = None,
    weights: str | Path | None = None,
    warp: Warp | None = None,
    disparity_range: DisparityRange | None = None,
    precision: str = "float32",
    occlusion: bool = False,
    view: tuple[int, int] | None = None,
    all_views: bool = False,
) -> Estimate:
    """Estimate the disparity of a light field's centre view, or of another view.

    A program is compiled once for each model and shape of light field. For several light fields,
    create the estimator once with :func:`make_estimator`, which reads the weights, and call
    :func:`run_estimator`.

    Args:
        light_field: Light field, see :func:`occjax.load`, or its views ``[V, U, H, W, C]``, see
            :class:`LightField`.
        model: Name of a model, see :func:`make_estimator`, or any :class:`Estimator`.
        weights: Weights, see :func:`make_estimator`.
        warp: Warp, see :func:`make_estimator`.
        disparity_range: ``(minimum, maximum)`` to search, in pixels per view step. By default the
            range of the light field. If it has none, ProposalNet and the training-free estimator
            measure it, and OccCasNet searches the range of its training.
        precision: Type of a network's convolutions, ``"float32"`` or ``"bfloat16"``.
        occlusion: Whether to compute the occlusion map of every view.
        view: ``(v, u)``, row and column of the view whose disparity is estimated, counted from 0;
            None for the centre view.
        all_views: Whether to estimate all views too and to compare their maps
            (:func:`estimate_all_views`), as ``views`` of the result.

    Returns:
        The estimate, as NumPy arrays. Its light field is that around the view
        (:meth:`LightField.around`).

    Raises:
        InputError: If model, weights, range and light field do not fit together, if there is no
            such view, or if the light field is a path.

    Example:
        >>> from occjax.data.bundled_sample import sample
        >>> views = sample().views[3:6, 3:6, :48, :48]
        >>> estimate(views, disparity_range=(-1.0, 1.0)).disparity.shape
        (48, 48)
    """
    if isinstance(light_field, str | Path):
        raise InputError(f"{light_field} is a path; pass occjax.load({str(light_field)!r})")
    if not isinstance(light_field, LightField):
        light_field = LightField(np.asarray(light_field))
    if view is not None and all_views:
        raise InputError("pass view or all_views, not both")
    if view is not None or all_views:
        light_field = with_report(light_field)
    if view is not None:
        light_field = light_field.around(view)
    if model is None or isinstance(model, str):
        model = make_estimator(model, weights=weights, warp=warp, precision=precision)
    result = run_estimator(model, light_field, disparity_range=disparity_range, occlusion=occlusion)
    if not all_views:
        return result
    from occjax.estimators.all_views import estimate_all_views

    views = estimate_all_views(model, light_field, disparity_range=disparity_range)
    return dataclasses.replace(result, views=views)


def with_report(light_field: LightField) -> LightField:
    """Return the light field with the report on its view order, so that it is measured once."""
    if light_field.view_order_report is not None or light_field.grid == (1, 1):
        return light_field
    return dataclasses.replace(light_field, view_order_report=check(light_field))


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
        report_phase: Function that is called when a phase begins.

    Returns:
        The estimate; ``seconds`` has the phases ``prepare``, ``compile``, ``run`` and, if
        requested, ``occlusion``.

    Raises:
        InputError: If the light field does not fit the estimator, or the range is not a range.

    Example:
        >>> from occjax.data.bundled_sample import sample
        >>> light_field = LightField(sample().views[3:6, 3:6, :48, :48])
        >>> result = run_estimator(make_estimator(), light_field, disparity_range=(-1.0, 1.0))
        >>> sorted(result.seconds)
        ['compile', 'prepare', 'run']
    """
    seconds: dict[str, float] = {}

    @contextmanager
    def timed(name: str, phase: Phase) -> Iterator[None]:
        report_phase(phase)
        begin = time.perf_counter()
        yield
        seconds[name] = time.perf_counter() - begin

    original = light_field
    with timed("prepare", Phase.PREPARING):
        light_field, corrections = registered(light_field)
        inputs = estimator.prepare(light_field, disparity_range)
        notes = (*corrections, *inputs.notes)
        if original.view is not None:
            v, u = original.view
            notes = (f"disparity of the view ({v}, {u}), row and column counted from 0", *notes)
        inputs = inputs._replace(notes=notes)
        arguments = (inputs.variables, inputs.views, *inputs.arguments)
    with (
        timed("compile", Phase.LOADING_PROGRAM),
        programs.reporting(lambda: report_phase(Phase.COMPILING)),
    ):
        structure, shapes = programs.signature(arguments)
        run = _compiled_run(programs.current_device(), estimator, structure, shapes)
        programs.release_memory()
    with timed("run", Phase.ESTIMATING):
        outputs = jax.tree.map(np.asarray, jax.block_until_ready(run(*arguments)))
    result = estimator.finish(inputs, outputs)
    if occlusion and result.occlusion is None:
        with timed("occlusion", Phase.OCCLUSION_MAPS):
            maps = estimate_occlusion(light_field, result.disparity)
        result = dataclasses.replace(result, occlusion=maps)
    limits = notes_on_limits(result.disparity, result.confidence, result.disparity_range)
    notes = (*result.notes, *limits)
    return dataclasses.replace(result, seconds=seconds, notes=notes, light_field=original)


def estimate_occlusion(light_field: LightField, disparity: np.ndarray) -> np.ndarray:
    """Compute the occlusion map of every view from a disparity map (OccCasNet, eqs. 4 and 5).

    Args:
        light_field: Light field whose views are where its offsets say; see
            :func:`occjax.layout.registered`.
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
) -> Exported:
    """Export the estimator as portable StableHLO with weights and candidates inside.

    The export runs without occjax, wherever StableHLO runs. It neither registers views nor corrects
    their brightness, and takes grey views only. Write ``exported.serialize()`` to a file (extra
    ``export``) and call ``jax.export.deserialize(data).call(views)`` with grey float32 views
    ``[v, u, h, w]`` in [0, 1]. ProposalNet uses the colour of a light field, so that its estimate
    differs slightly from that of the export.

    Args:
        estimator: From :func:`make_estimator`.
        light_field: Light field of the shape and the arrangement of views to export for.
        disparity_range: ``(minimum, maximum)`` to search; by default as in :func:`estimate`.
        platforms: Platforms to export for, such as ``("cpu", "cuda")``; by default the current one.

    Returns:
        Function of the views that returns a dictionary with ``disparity``, ``confidence`` and the
        other maps of :class:`Estimate`.

    Raises:
        InputError: If the light field does not fit the estimator, or the extra ``export`` is
            missing, without which the export could not be written.

    Example:
        >>> from occjax.data.bundled_sample import sample
        >>> light_field = LightField(sample().views[3:6, 3:6, :48, :48])
        >>> photometric = make_estimator("photometric")
        >>> exported = export_estimator(photometric, light_field, disparity_range=(-1.0, 1.0))
        >>> [shape.shape for shape in exported.in_avals]
        [(3, 3, 48, 48)]
    """
    if importlib.util.find_spec("flatbuffers") is None:  # jax.export serialises with it
        raise InputError("an export needs flatbuffers; run pip install 'occjax[export]'")
    light_field = registered(light_field)[0]
    # Arguments are constants of the function; the colour of this light field must not be one.
    light_field = dataclasses.replace(light_field, views=light_field.grey()[..., None])
    inputs = estimator.prepare(light_field, disparity_range)
    arguments = jax.tree.map(jnp.asarray, inputs.arguments)
    indices, image_shape = inputs.view_indices, inputs.views.shape[2:]

    def run(views):
        if indices is not None:
            views = views.reshape(1, -1, *image_shape)[:, indices]
        return estimator.run(inputs.variables, views, *arguments)

    grid = inputs.views.shape[:2] if indices is None else light_field.grid
    shape = jax.ShapeDtypeStruct((*grid, *image_shape), inputs.views.dtype)
    return export(jax.jit(run), platforms=platforms)(shape)


@programs.cached_per_device(MAX_LOADED_ESTIMATORS)
def _compiled_run(
    device: jax.Device, estimator: Any, structure: Any, shapes: tuple
) -> Callable[..., Any]:
    """Return ``estimator.run``, compiled for arguments of these shapes or loaded if it was kept."""
    name = program_identity(estimator)
    return programs.load_or_compile(estimator.run, structure, shapes, name, device)


def program_identity(estimator: Any) -> tuple | None:
    """Return what the program of an estimator depends on, besides the source code of occjax.

    Returns:
        Its class and the fields that are compared; None for a class outside of this package, whose
        source code may change.

    Example:
        >>> program_identity(make_estimator("photometric"))[1]
        'ProposalEstimator'
    """
    kind = type(estimator)
    if not kind.__module__.startswith("occjax."):
        return None
    compared = [field.name for field in dataclasses.fields(estimator) if field.compare]
    values = tuple((name, getattr(estimator, name)) for name in compared)
    return (kind.__module__, kind.__qualname__, values)


@programs.kept
def _occlusion_maps(views, disparity, offsets):
    from occjax.ops import occlusion_maps

    return occlusion_maps(views, disparity, offsets=offsets)
