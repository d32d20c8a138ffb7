"""Aggregation for inference on a CPU: BatchNorm folded into the kernels, computed row by row.

It computes the same sums as :class:`occjax.models.occcasnet.aggregation.Aggregation` in another
order. Its working set fits into the processor's cache, and it needs half of the multiplications
(:mod:`occjax.kernels.minimal_filtering`).
"""

from __future__ import annotations

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.kernels.minimal_filtering import (
    OUTPUT_ROWS,
    ReadRows,
    convolve_rows,
    rows_between_zeros,
)
from occjax.models.occcasnet.config import AggregationConfig
from occjax.models.occcasnet.layers import BATCH_NORM_EPSILON


def aggregate_rows(
    read: ReadRows,
    height: int,
    variables: Mapping[str, Mapping],
    name: str,
    config: AggregationConfig,
    weights: Float[Array, " c"] | None = None,
) -> Float[Array, "d h w"]:
    """Aggregate a volume that is read in rows into scores of the candidates.

    Args:
        read: Function that returns the rows of the volume that
            :func:`occjax.kernels.minimal_filtering.convolve_rows` needs.
        height: Number of rows of the volume, at least 4.
        variables: Variables of :class:`occjax.models.OccCasNet`.
        name: Name of the aggregation in the variables.
        config: Layers of the aggregation.
        weights: ``[c]`` attention weight of each channel of the volume.

    Returns:
        ``[d, h, w]`` scores.
    """
    parameters, statistics = variables["params"][name], variables["batch_stats"][name]

    def layer(read, layer_name, residual=None, weights=None):
        """Convolve, normalise, then apply ReLU or add a residual, which has a row of padding."""
        kernel = parameters[layer_name]["kernel"]
        norm, moments = parameters[f"{layer_name}_norm"], statistics[f"{layer_name}_norm"]
        scale = norm["scale"] * jax.lax.rsqrt(moments["var"] + BATCH_NORM_EPSILON)
        kernel = kernel * scale[None, None, None, None]
        if weights is not None:
            kernel = kernel * weights[None, None, None, :, None]
        shift = (norm["bias"] - moments["mean"] * scale)[None, None, None]

        def finish(rows, start):
            rows = rows + shift
            if residual is None:
                return jax.nn.relu(rows)
            return rows + jax.lax.dynamic_slice_in_dim(residual, start + 1, OUTPUT_ROWS)

        return convolve_rows(read, height, kernel, finish)

    x = layer(read, "conv_0", weights=weights)
    x = layer(rows_between_zeros(x), "conv_1")
    for pair in range(config.pairs):
        inner = layer(rows_between_zeros(x), f"pair_{pair}_conv_0")
        x = layer(rows_between_zeros(inner), f"pair_{pair}_conv_1", residual=x)
    x = layer(rows_between_zeros(x), "conv_2")
    return _score(x, parameters["score"]["kernel"])


def _score(
    volume: Float[Array, "n d w c"], kernel: Float[Array, "3 3 3 c 1"]
) -> Float[Array, "d h w"]:
    """Convolve a volume, padded by one row of zeros on each side, to one channel.

    One matrix product computes all 27 taps at every voxel. The results are then shifted and added.
    """
    padded_rows, d, w, channels = volume.shape
    h = padded_rows - 2
    products = jnp.einsum("hdwc,nc->hdwn", volume, kernel.reshape(27, channels))
    products = jnp.pad(products, ((0, 0), (1, 1), (1, 1), (0, 0)))
    result = sum(
        products[row : row + h, candidate : candidate + d, column : column + w, tap]
        for tap, (candidate, row, column) in enumerate(np.ndindex(3, 3, 3))
    )
    return jnp.moveaxis(jnp.asarray(result), 0, 1)
