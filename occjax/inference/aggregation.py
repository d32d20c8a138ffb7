"""The aggregation as inference computes it on a CPU: BatchNorm in the kernels, row by row.

The same sums as :class:`occjax.models.aggregation.Aggregation` in another order. Its parts fit into
the processor's cache, and it has half of the multiplications, see
:mod:`occjax.ops.minimal_filtering`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from occjax.models.config import Residual
from occjax.models.layers import EPSILON
from occjax.ops.minimal_filtering import ROWS, convolve_rows, row_kernels, rows_between_zeros

Read = Callable[[Int[Array, ""]], Float[Array, "6 d w c"]]


def aggregate_rows(
    read: Read,
    height: int,
    variables: Mapping[str, Mapping],
    name: str,
    config: Residual,
    weights: Float[Array, " c"] | None = None,
) -> Float[Array, "d h w"]:
    """Scores of a volume that is made while it is read.

    Args:
        read: See :func:`occjax.ops.minimal_filtering.convolve_rows`.
        height: Rows of the volume, four or more.
        variables: Of :class:`occjax.models.OccCasNet`.
        name: Of the aggregation among them.
        config: Its layers.
        weights: ``[c]`` factor of each channel of the volume.

    Returns:
        ``[d, h, w]``.
    """
    parameters, statistics = variables["params"][name], variables["batch_stats"][name]

    def layer(read, name, residual=None, weights=None):
        kernel = parameters[name]["kernel"]
        norm, average = parameters[f"{name}_norm"], statistics[f"{name}_norm"]
        scale = norm["scale"] * jax.lax.rsqrt(average["var"] + EPSILON)
        kernel = kernel * scale[None, None, None, None]
        if weights is not None:
            kernel = kernel * weights[None, None, None, :, None]
        shift = (norm["bias"] - average["mean"] * scale)[None, None, None]

        def finish(rows, start):
            rows = rows + shift
            if residual is None:
                return jax.nn.relu(rows)
            return rows + jax.lax.dynamic_slice_in_dim(residual, start + 1, ROWS)

        return convolve_rows(read, height, row_kernels(kernel), finish)

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
    """Convolution of a volume, its rows between two of zeros, to one channel.

    Every tap at every voxel by one matrix product, then shifted.
    """
    between, candidates, width, channels = volume.shape
    taps = kernel.reshape(27, channels)
    products = jnp.einsum("hdwc,nc->hdwn", volume, taps)
    products = jnp.pad(products, ((0, 0), (1, 1), (1, 1), (0, 0)))
    result = sum(
        products[row : row + between - 2, depth : depth + candidates, column : column + width, tap]
        for tap, (depth, row, column) in enumerate(
            (depth, row, column) for depth in range(3) for row in range(3) for column in range(3)
        )
    )
    return jnp.moveaxis(jnp.asarray(result), 0, 1)
