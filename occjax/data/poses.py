"""Poses: affine maps ``[3, 4]`` from the coordinates of a thing to those of what it stands in."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from occjax.data.textures import Scalar


def translation(x: Scalar, y: Scalar, z: Scalar) -> Float[Array, "3 4"]:
    """Affine map that moves by (x, y, z)."""
    return jnp.concatenate([jnp.eye(3), jnp.array([[x], [y], [z]], jnp.float32)], axis=1)


def rotation(axis: str, degrees: Scalar) -> Float[Array, "3 4"]:
    """Affine map that turns about the x, y or z axis."""
    angle = jnp.radians(degrees)
    first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix = jnp.eye(3)
    matrix = matrix.at[first, first].set(jnp.cos(angle)).at[second, second].set(jnp.cos(angle))
    matrix = matrix.at[first, second].set(-jnp.sin(angle)).at[second, first].set(jnp.sin(angle))
    return jnp.concatenate([matrix, jnp.zeros((3, 1))], axis=1)


def compose(*maps: Float[Array, "3 4"]) -> Float[Array, "3 4"]:
    """The affine map that applies the last of ``maps`` first."""
    result = maps[0]
    for inner in maps[1:]:
        linear = result[:, :3] @ inner[:, :3]
        offset = result[:, :3] @ inner[:, 3:] + result[:, 3:]
        result = jnp.concatenate([linear, offset], axis=1)
    return result
