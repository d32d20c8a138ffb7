"""OccCasNet on images of any size in bounded memory.

The aggregation of a volume of concatenated features needs nearly all of the memory and time. It is
computed in strips of rows. A strip is read with a halo as wide as the receptive field of the
aggregation, so that its inner rows equal those of the whole image. Two steps depend on the whole
image and are computed first: the features, since their spatial pyramid reaches far, and the mean
over the volume, which is the input of the view attention.

On a CPU in float32 the aggregation needs half of the multiplications
(:mod:`occjax.kernels.minimal_filtering`).
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
from occjax.kernels.minimal_filtering import INPUT_ROWS, OUTPUT_ROWS
from occjax.lightfield import view_offsets
from occjax.models.occcasnet.config import OccCasNetConfig
from occjax.models.occcasnet.network import OccCasNet, combine_function
from occjax.models.occcasnet.row_aggregation import aggregate_rows
from occjax.models.occcasnet.stages import StageOutput, regress_stage
from occjax.ops import (
    coarse_volume,
    coarse_volume_means,
    concatenate,
    occlusion_weights,
    refined_volume,
)


def predict(
    variables: dict,
    views: Float[Array, "v u h w"],
    config: OccCasNetConfig,
    *,
    candidates: Float[Array, " d"] | None = None,
    ground_truth: Float[Array, "h w"] | None = None,
    dtype: DTypeLike = jnp.float32,
    strip_rows: int | None = None,
) -> tuple[StageOutput, ...]:
    """Compute ``OccCasNet(config).apply(variables, views)`` in strips, in bounded memory.

    A pure function: it works under ``jit`` (``config``, ``dtype`` and ``strip_rows`` static),
    ``vmap`` and ``grad``.

    Args:
        variables: Variables of :class:`occjax.models.OccCasNet`.
        views: ``[v, u, h, w]`` grey views in [0, 1].
        config: The network.
        candidates: ``[d]`` disparities of the first stage instead of the configured ones.
        ground_truth: ``[h, w]`` disparity, for networks that compute occlusion maps from it.
        dtype: Type of the convolutions.
        strip_rows: Number of rows of a strip. Memory is proportional to this number plus twice the
            halo. :func:`rows_of_strip` gives the default.

    Returns:
        One :class:`StageOutput` per stage; the last one is the result.

    Raises:
        InputError: If the grid is not the configured one.
        ValueError: If the ground truth is missing.

    Example:
        >>> from occjax.models import preset
        >>> config = preset("tiny")
        >>> views = jnp.zeros((3, 3, 16, 16))
        >>> variables = jax.jit(OccCasNet(config).init)(jax.random.key(0), views)
        >>> compiled = jax.jit(predict, static_argnames="config")
        >>> compiled(variables, views, config=config)[-1].disparity.shape
        (16, 16)
    """
    if strip_rows is not None and strip_rows < 1:
        raise InputError(f"strip_rows must be positive, not {strip_rows}")
    network = OccCasNet(config, dtype=dtype)
    network.check_grid(views)
    height, width = views.shape[2:]
    largest_halo = max(stage.aggregation.halo for stage in config.stages)
    fits_one_strip = rows_of_strip(height, width, largest_halo, dtype) == height
    if strip_rows is None and fits_one_strip and not _is_on_cpu():
        return network.apply(variables, views, candidates=candidates, ground_truth=ground_truth)  # type: ignore[return-value]

    def method(name, *args, **options):
        return network.apply(variables, *args, **options, method=name)

    # One row of views at a time: 40 channels of all views at once would take gigabytes.
    features = jax.lax.platform_dependent(
        views,
        cpu=lambda views: jax.lax.map(lambda row: method("extract", row[None])[0], views),
        default=partial(method, "extract"),
    )
    outputs: list[StageOutput] = []
    for index, stage in enumerate(config.stages):
        before = outputs[-1].disparity if outputs else None
        with jax.ensure_compile_time_eval():  # constant while tracing
            values = jnp.asarray(stage.candidates, jnp.float32)
        if before is None and candidates is not None:
            values = candidates
        maps = method("occlusion", index, views, before, ground_truth)
        offsets = view_offsets(*config.views) if before is None else network.warp_offsets()
        volume = _StageVolume(
            features, values, before, maps, jnp.asarray(offsets), combine_function(config, index)
        )
        attention = method("attend", index, volume.channel_means()) if stage.attention else None
        compute = partial(_score_strip, network, variables, index, volume, attention)
        halo = stage.aggregation.halo
        rows = strip_rows or rows_of_strip(height, width, halo, dtype)
        scores = _in_strips(compute, height=height, rows=rows, halo=halo)
        outputs.append(regress_stage(scores, values, before, attention, maps))
    return tuple(outputs)


def rows_of_strip(height: int, width: int, halo: int, dtype: DTypeLike = jnp.float32) -> int:
    """Return the number of rows of a strip: strips have equal heights and none is too large.

    A strip with its halo has at most 49,152 pixels if JAX's default device is a CPU, with which
    ``occcasnet`` needs less than 4 GB; else one channel of it has at most 256 KiB.

    Args:
        height: Height of the centre view, in pixels.
        width: Width of the centre view, in pixels.
        halo: Rows read on each side of a strip.
        dtype: Type of the convolutions.

    Returns:
        The height if one strip suffices; at least 1.
    """
    max_pixels = 3 * 2**14 if _is_on_cpu() else 2**18 // jnp.dtype(dtype).itemsize
    max_rows = max_pixels // width
    if height <= max_rows:
        return height
    strips = math.ceil(height / max(1, max_rows - 2 * halo))
    return math.ceil(height / strips)


def _is_on_cpu() -> bool:
    """Return whether JAX's default device is a CPU."""
    device = getattr(jax.config, "jax_default_device", None)  # a context may have set it
    return (getattr(device, "platform", device) or jax.default_backend()) == "cpu"


def _score_strip(
    network: OccCasNet,
    variables: dict,
    index: int,
    volume: _StageVolume,
    attention: Float[Array, "v u"] | None,
    first: Int[Array, ""],
    rows: int,
) -> Float[Array, "d r w"]:
    """Compute a strip of rows of the scores of a stage."""
    height, channels = volume.features.shape[2], volume.features.shape[-1]

    def by_layers(first):
        strip = volume.strip(first, rows, attention)
        return network.apply(variables, index, strip, None, method="aggregate")

    def by_rows(first):
        strip = volume.strip_with_halo_rows(first, rows)

        def read(start):
            taken = jax.lax.dynamic_slice_in_dim(strip, start + 1, INPUT_ROWS, axis=1)
            row = first + start + jnp.arange(INPUT_ROWS)
            inside = (row >= 0) & (row < height)
            return jnp.where(inside[:, None, None, None], jnp.moveaxis(taken, 1, 0), 0.0)

        name = f"aggregation_{network.config.part_index(index)}"
        weights = None if attention is None else jnp.repeat(attention.reshape(-1), channels)
        config = network.config.stages[index].aggregation
        return aggregate_rows(read, rows, variables, name, config, weights)

    if height < OUTPUT_ROWS or jnp.dtype(network.dtype) != jnp.float32:
        return by_layers(first)
    # On a CPU, half of the multiplications suffice.
    return jax.lax.platform_dependent(first, cpu=by_rows, default=by_layers)


class _StageVolume:
    """Cost volume of a stage, computed in parts."""

    def __init__(self, features, candidates, before, maps, offsets, combine):
        self.features, self.candidates, self.before = features, candidates, before
        self.weights = None if maps is None else occlusion_weights(maps)
        self.offsets, self.combine = offsets, combine

    def channel_means(self) -> Float[Array, " k"]:
        """Compute the mean of each channel over candidates and pixels, without the volume."""
        if self.before is None and self.weights is None:
            return coarse_volume_means(self.features, self.candidates, offsets=self.offsets)

        def mean_of_plane(views, weights):
            plane = concatenate(views, weights)
            return plane.mean((0, 1), keepdims=True, dtype=jnp.float32)

        def row_of_views(row):
            features, offsets, weights = jax.tree.map(lambda array: array[None], row)
            means = self._rows(0, features.shape[2], features, offsets, weights, mean_of_plane)
            return means.mean((0, 1, 2))

        return jax.lax.map(row_of_views, (self.features, self.offsets, self.weights)).reshape(-1)

    def strip(
        self, first: Int[Array, ""], rows: int, attention: Float[Array, "v u"] | None
    ) -> Float[Array, "d r w k"]:
        """Compute a strip of rows of the volume, each view weighted by attention."""
        weights = self.weights
        if weights is not None:
            weights = jax.lax.dynamic_slice_in_dim(weights, first, rows, 2)
        if attention is not None:
            per_view = attention[:, :, None, None]
            shape = (*attention.shape, rows, self.features.shape[3])
            weights = jnp.broadcast_to(per_view, shape) if weights is None else weights * per_view
        return self._rows(first, rows, self.features, self.offsets, weights, self.combine)

    def strip_with_halo_rows(self, first: Int[Array, ""], rows: int) -> Float[Array, "d n w k"]:
        """Compute a strip of cost-volume rows with one halo row on each side.

        Halo rows outside the image have undefined content.
        """
        if self.before is not None or self.weights is not None:
            return jnp.pad(self.strip(first, rows, None), ((0, 0), (1, 1), (0, 0), (0, 0)))
        return self._rows(first - 1, rows + 2, self.features, self.offsets, None, self.combine)

    def _rows(self, first, rows, features, offsets, weights, combine):
        """Compute rows of the volume of some views."""
        options = {"weights": weights, "offsets": offsets, "combine": combine, "streamed": True}
        if self.before is None:
            return coarse_volume(features, self.candidates, rows=(first, rows), **options)
        before = jax.lax.dynamic_slice_in_dim(self.before, first, rows)
        return refined_volume(features, before, self.candidates, first_row=first, **options)


def _in_strips(compute, *, height: int, rows: int, halo: int) -> Float[Array, "d h w"]:
    """Assemble ``compute(first_row, rows) -> [d, r, w]`` over the whole height.

    All strips have the same size and lie within the image. At each end of a strip, either the image
    ends as well and zero padding is correct, or at least ``halo`` further rows were read.
    """
    if height <= rows + 2 * halo:
        return compute(jnp.int32(0), height)
    kept = np.minimum(np.arange(0, height, rows), height - rows)  # the last strip overlaps
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
