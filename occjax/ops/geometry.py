"""Where a point of the centre view lies in the other views."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float


def view_offsets(v: int, u: int) -> Float[Array, "v u 2"]:
    """Offset ``(row, column)`` of each view of a regular grid from the centre view.

    The centre view is ``(v // 2, u // 2)``. A light field taken at irregular positions passes those
    in place of this; swapping the last axis gives the transposed warp of the published code.

    Args:
        v: Number of view rows.
        u: Number of view columns.

    Returns:
        ``[v, u, 2]`` float32 offsets in view steps.

    Example:
        >>> view_offsets(3, 3)[0, 2].tolist()
        [-1.0, 1.0]
    """
    rows = jnp.arange(v, dtype=jnp.float32) - v // 2
    columns = jnp.arange(u, dtype=jnp.float32) - u // 2
    return jnp.stack(jnp.meshgrid(rows, columns, indexing="ij"), axis=-1)
