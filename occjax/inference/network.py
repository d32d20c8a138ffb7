"""OccCasNet on images of any size in bounded memory.

For volumes that concatenate features, the aggregation takes nearly all of the memory and time. It
is computed in strips of rows. A strip is read with a halo as wide as the aggregation's receptive
field, so its inner rows are those of the whole image. Two things look at the whole image and are
computed before: the features (their spatial pyramid reaches far) and the mean over the volume from
which the view attention is made.

On a CPU in float32 the aggregation has half of the multiplications, see
:mod:`occjax.ops.minimal_filtering`.

Networks of any arrangement of views are computed whole: what they keep does not grow with the
number of views.
"""

from __future__ import annotations

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float, Int

from occjax.errors import InputError
from occjax.inference.aggregation import aggregate_rows
from occjax.models import NetworkConfig, OccCasNet, StageOutput
from occjax.models.cascade import COMBINED
from occjax.models.config import Residual, of_kind
from occjax.models.stages import stage_output
from occjax.ops import (
    coarse_volume,
    coarse_volume_means,
    concatenate,
    occlusion_weights,
    refined_volume,
    view_offsets,
)
from occjax.ops.minimal_filtering import READ, ROWS

STRIP_PIXELS = 3 * 2**14
"""Pixels of a strip, halo included: ``occcasnet`` then needs less than four gigabytes."""

STRIP_PIXELS_OF_ACCELERATOR = 2**18
"""The same on a GPU, divided by the bytes of a number: larger strips read less of it twice."""


def infer(
    variables: dict,
    views: Float[Array, "v u h w"],
    config: NetworkConfig,
    *,
    candidates: Float[Array, " d"] | None = None,
    ground_truth: Float[Array, "h w"] | None = None,
    offsets: Float[Array, "v u 2"] | None = None,
    dtype: DTypeLike = jnp.float32,
    strip_rows: int | None = None,
) -> tuple[StageOutput, ...]:
    """What ``OccCasNet(config).apply(variables, views)`` computes, strip by strip.

    A pure function: jit it (``config``, ``dtype`` and ``strip_rows`` static), vmap it,
    differentiate it.

    Args:
        variables: Of :class:`occjax.models.OccCasNet`.
        views: ``[v, u, h, w]`` grey views in [0, 1].
        config: The network.
        candidates: ``[d]`` disparities of the first stage in place of the configured ones.
        ground_truth: ``[h, w]`` disparity, for networks whose occlusion maps come from it.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, for
            networks of any arrangement of views.
        dtype: Type of the convolutions.
        strip_rows: Rows computed at a time; memory is proportional to this plus twice the halo. By
            default those of :func:`rows_of_strip`.

    Returns:
        One :class:`StageOutput` per stage; the last is the answer.

    Raises:
        InputError: If the grid is not the configured one.
        ValueError: If the ground truth is missing.
    """
    if strip_rows is not None and strip_rows < 1:
        raise InputError(f"strip_rows must be positive, not {strip_rows}")
    network = OccCasNet(config, dtype=dtype)
    network.check_grid(views)
    if config.views is None:
        outputs = network.apply(variables, views, candidates=candidates, offsets=offsets)
        return of_kind(outputs, tuple)
    if strip_rows is None and _is_whole(views.shape[2:], config, dtype):
        outputs = network.apply(variables, views, candidates=candidates, ground_truth=ground_truth)
        return of_kind(outputs, tuple)

    def method(name, *args, **options):
        return network.apply(variables, *args, **options, method=name)

    # A row of views at a time: 40 channels of all views at once would be gigabytes.
    features = jax.lax.platform_dependent(
        views,
        cpu=lambda views: jax.lax.map(lambda row: method("extract", row[None])[0], views),
        default=partial(method, "extract"),
    )
    done: list[StageOutput] = []
    for index, stage in enumerate(config.stages):
        before = done[-1].disparity if done else None
        with jax.ensure_compile_time_eval():  # known while tracing
            values = jnp.asarray(stage.candidates, jnp.float32)
        if before is None and candidates is not None:
            values = candidates
        maps = method("occlusion", index, views, before, ground_truth)
        volume = _StageVolume(
            features, values, before, maps, _offsets(network, before), COMBINED[stage.volume]
        )
        attention = method("attend", index, volume.channel_means()) if stage.attention else None
        compute = _on_volume(method, index, volume, attention)
        if views.shape[2] >= ROWS and jnp.dtype(dtype) == jnp.float32:
            in_rows = _in_rows(variables, config, index, volume, attention)
            compute = _by_platform(cpu=in_rows, default=compute)
        halo = of_kind(stage.aggregation, Residual).halo
        rows = strip_rows or rows_of_strip(views.shape[2], views.shape[3], halo, dtype)
        scores = _in_strips(compute, height=views.shape[2], rows=rows, halo=halo)
        done.append(stage_output(scores, values, before, attention, maps))
    return tuple(done)


def rows_of_strip(height: int, width: int, halo: int, dtype: DTypeLike = jnp.float32) -> int:
    """Rows computed at a time, so that strips are even and none has too many pixels.

    Too many are more than STRIP_PIXELS or, if JAX's default device is no CPU, than
    STRIP_PIXELS_OF_ACCELERATOR by the bytes of a number.

    Args:
        height: Of the centre view, in pixels.
        width: Likewise.
        halo: Rows read on either side.
        dtype: Type of the convolutions.

    Returns:
        The height, if that many pixels make one strip; one at least.
    """
    most = STRIP_PIXELS_OF_ACCELERATOR // jnp.dtype(dtype).itemsize
    read = (STRIP_PIXELS if _is_on_cpu() else most) // width
    if height <= read:
        return height
    strips = math.ceil(height / max(1, read - 2 * halo))
    return math.ceil(height / strips)


def _is_whole(size: tuple[int, ...], config: NetworkConfig, dtype: DTypeLike) -> bool:
    """Whether the image is one strip of an accelerator, whose volumes are made at once."""
    halos = [of_kind(stage.aggregation, Residual).halo for stage in config.stages]
    one_strip = rows_of_strip(size[0], size[1], max(halos), dtype) == size[0]
    return one_strip and not _is_on_cpu()


def _is_on_cpu() -> bool:
    """Whether JAX computes on a CPU unless it is told otherwise."""
    device = getattr(jax.config, "jax_default_device", None)  # as a context has set it
    return (getattr(device, "platform", device) or jax.default_backend()) == "cpu"


def _offsets(network: OccCasNet, before: Array | None) -> Float[Array, "v u 2"]:
    grid = of_kind(network.config.views, tuple)
    return view_offsets(*grid) if before is None else network.warp_offsets()


def _on_volume(method, index, volume, attention):
    """Scores of a strip ``(first_row, number_of_rows) -> [d, r, w]`` from its volume."""

    def scores(first, rows):
        return method("aggregate", index, volume.strip(first, rows, attention), None)

    return scores


def _by_platform(*, cpu, default):
    def scores(first, rows):
        functions = {"cpu": partial(cpu, rows=rows), "default": partial(default, rows=rows)}
        return jax.lax.platform_dependent(first, **functions)

    return scores


def _in_rows(variables, config, index, volume, attention):
    """The same with half of the multiplications and in an order that suits a CPU's cache."""
    name = f"aggregation_{0 if config.shared_aggregation else index}"
    residual = of_kind(config.stages[index].aggregation, Residual)
    weights = None
    if attention is not None:
        channels = volume.features.shape[-1]
        weights = jnp.repeat(attention.reshape(-1), channels)

    def scores(first, rows):
        made = volume.framed(first, rows)
        height = volume.features.shape[2]

        def read(start):
            taken = jax.lax.dynamic_slice_in_dim(made, start + 1, READ, axis=1)
            numbers = first + start + jnp.arange(READ)
            inside = (numbers >= 0) & (numbers < height)
            return jnp.where(inside[:, None, None, None], jnp.moveaxis(taken, 1, 0), 0.0)

        return aggregate_rows(read, rows, variables, name, residual, weights)

    return scores


class _StageVolume:
    """The cost volume of a stage, computed in parts."""

    def __init__(self, features, candidates, before, maps, offsets, combine):
        self.features, self.candidates, self.before = features, candidates, before
        self.weights = None if maps is None else occlusion_weights(maps)
        self.offsets, self.combine = offsets, combine

    def channel_means(self) -> Float[Array, " k"]:
        """Mean of each channel over candidates and pixels; warped, one row of views at a time."""
        if self.before is None and self.weights is None:
            return coarse_volume_means(self.features, self.candidates, offsets=self.offsets)

        def mean_of_plane(views, weights):
            plane = concatenate(views, weights)
            return plane.mean((0, 1), keepdims=True, dtype=jnp.float32)

        def row_of_views(row):
            features, offsets, weights = jax.tree.map(lambda array: array[None], row)
            options = {
                "weights": weights,
                "offsets": offsets,
                "combine": mean_of_plane,
                "streamed": True,
            }
            if self.before is None:
                means = coarse_volume(features, self.candidates, **options)
            else:
                means = refined_volume(features, self.before, self.candidates, **options)
            return means.mean((0, 1, 2))

        return jax.lax.map(row_of_views, (self.features, self.offsets, self.weights)).reshape(-1)

    def strip(
        self, first: Int[Array, ""], rows: int, attention: Float[Array, "v u"] | None
    ) -> Float[Array, "d r w k"]:
        """Some rows of the volume, each view weighted by attention."""

        def cut(array, axis):
            return jax.lax.dynamic_slice_in_dim(array, first, rows, axis)

        weights = None if self.weights is None else cut(self.weights, 2)
        if attention is not None:
            per_view = attention[:, :, None, None]
            shape = (*attention.shape, rows, self.features.shape[3])
            weights = jnp.broadcast_to(per_view, shape) if weights is None else weights * per_view
        options = {
            "weights": weights,
            "offsets": self.offsets,
            "combine": self.combine,
            "streamed": True,
        }
        if self.before is None:
            return coarse_volume(self.features, self.candidates, rows=(first, rows), **options)
        before = cut(self.before, 0)
        return refined_volume(self.features, before, self.candidates, first_row=first, **options)

    def framed(self, first: Int[Array, ""], rows: int) -> Float[Array, "d n w k"]:
        """Some rows of the volume between two more, whatever they hold where they lie beside it."""
        if self.before is not None or self.weights is not None:
            return jnp.pad(self.strip(first, rows, None), ((0, 0), (1, 1), (0, 0), (0, 0)))
        return coarse_volume(
            self.features,
            self.candidates,
            rows=(first - 1, rows + 2),
            offsets=self.offsets,
            combine=self.combine,
            streamed=True,
        )


def _in_strips(compute, *, height: int, rows: int, halo: int) -> Float[Array, "d h w"]:
    """Assemble ``compute(first_row, number_of_rows) -> [d, r, w]`` over the whole height.

    All strips have one size and lie within the image: where a strip ends, the image ends too (and
    the zero padding there is right) or at least ``halo`` further rows were read.
    """
    if height <= rows + 2 * halo:
        return compute(jnp.int32(0), height)
    kept = np.minimum(np.arange(0, height, rows), height - rows)  # the last one overlaps
    read = np.clip(kept - halo, 0, height - rows - 2 * halo)

    def strip(starts):
        kept, read = starts
        return jax.lax.dynamic_slice_in_dim(
            compute(read, rows + 2 * halo), kept - read, rows, axis=1
        )

    strips = jax.lax.map(strip, (jnp.asarray(kept, jnp.int32), jnp.asarray(read, jnp.int32)))
    inner = jnp.moveaxis(strips[:-1], 0, 1).reshape(strips.shape[1], -1, strips.shape[3])
    overlap = inner.shape[1] - int(kept[-1])
    return jnp.concatenate([inner, strips[-1][:, overlap:]], axis=1)
