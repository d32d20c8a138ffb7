"""From a disparity map of half resolution to the full one, along the edges of the image."""

from __future__ import annotations

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from occjax.models.layers import ConvRelu


def _bilinear_weights() -> np.ndarray:
    """``[9, 2, 2]`` weights of the 3x3 coarse pixels for the 2x2 fine ones in the middle one."""
    along = np.array([[0.25, 0.0], [0.75, 0.75], [0.0, 0.25]], np.float32) + 1e-3
    return np.einsum("ai,bj->abij", along, along).reshape(9, 2, 2)


_BILINEAR = _bilinear_weights()
"""What learned weights multiply, so that a network begins with bilinear interpolation."""


class ConvexUpsampling(nn.Module):
    """Each fine pixel is a mean of the 3x3 coarse pixels around it, with learned weights.

    A mean keeps within what its neighbours say, and the weights can lie all on one side of an edge
    (Teed, Deng, RAFT, ECCV 2020, section 3.3).

    Attributes:
        width: Channels of the convolution that makes the weights.
        dtype: Type of the computation.
    """

    width: int = 32
    dtype: DTypeLike = jnp.float32

    @nn.compact
    def __call__(
        self,
        disparity: Float[Array, "h w"],
        deviation: Float[Array, "h w"],
        guide: Float[Array, "1 h w g"],
    ) -> Float[Array, "i j"]:
        """Disparity at twice the resolution.

        Args:
            disparity: ``[h, w]``, pixels of the full resolution per view step.
            deviation: ``[h, w]`` standard deviation over the candidates.
            guide: ``[1, h, w, g]`` features of the centre view.

        Returns:
            ``[2 h, 2 w]``.
        """
        h, w = disparity.shape
        known = jnp.stack([disparity, jnp.log(deviation + 0.03)], axis=-1)[None]
        x = jnp.concatenate([guide, jax.lax.stop_gradient(known).astype(self.dtype)], axis=-1)
        x = ConvRelu(self.width, dtype=self.dtype, name="hidden")(x)
        zeros = nn.initializers.zeros
        weights = nn.Conv(36, (1, 1), kernel_init=zeros, dtype=self.dtype, name="weights")(x)[0]
        weights = (
            weights.astype(jnp.float32).reshape(h, w, 9, 2, 2) + jnp.log(_BILINEAR)[None, None]
        )
        weights = jax.nn.softmax(weights, axis=2)
        fine = jnp.einsum("hwnij,nhw->hiwj", weights, neighbours(disparity))
        return fine.reshape(2 * h, 2 * w)


def neighbours(image: Float[Array, "h w"]) -> Float[Array, "9 h w"]:
    """The 3x3 pixels around each, row by row, borders replicated.

    Example:
        >>> neighbours(jnp.arange(9.0).reshape(3, 3))[:, 1, 1].tolist()
        [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    """
    h, w = image.shape
    padded = jnp.pad(image, 1, mode="edge")
    return jnp.stack([padded[y : y + h, x : x + w] for y in range(3) for x in range(3)])
