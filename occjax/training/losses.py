"""Parts of the training losses that all models share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from occjax.evaluation.metrics import BAD_PIXEL_THRESHOLD
from occjax.training.config import LossConfig, Penalty


class WeightedSum(NamedTuple):
    """Weighted sum over the pixels of a light field, or of each light field of a batch.

    Attributes:
        value: Sum of the weighted values.
        weight: Sum of the weights.
    """

    value: Float[Array, "*b"]
    weight: Float[Array, "*b"]

    def mean(self) -> Float[Array, ""]:
        """Return the weighted mean over all light fields; 0 if no pixel counts."""
        return self.value.sum() / jnp.maximum(self.weight.sum(), 1.0)


def total_loss(means: Mapping[str, Float[Array, ""]], config: LossConfig) -> Float[Array, ""]:
    """Compute the loss from the means of its errors over the batch.

    Args:
        means: Mean errors by name. ``disparity`` and ``distribution``, or names that begin with
            them, are parts of the loss; others, such as ``badpix``, are not.
        config: Its weight of the distribution.

    Example:
        >>> means = {"disparity": jnp.array(0.5), "distribution": jnp.array(2.0)}
        >>> float(total_loss(means, LossConfig(distribution=0.25)))
        1.0
    """
    loss = jnp.zeros(())
    for name, mean in means.items():
        if name.startswith("disparity"):
            loss += mean
        elif name.startswith("distribution"):
            loss += config.distribution * mean
    return loss


def weighted_sum(
    values: Float[Array, "h w"], weights: Float[Array, "h w"] | Bool[Array, "h w"]
) -> WeightedSum:
    """Sum values over pixels, with weights of 0 or more. Values of weight 0 may be NaN."""
    weights = weights.astype(values.dtype)
    return WeightedSum(jnp.where(weights > 0.0, values * weights, 0.0).sum(), weights.sum())


def penalty(
    error: Float[Array, "*shape"], *, kind: Penalty = "l1", width: float = 0.02
) -> Float[Array, "*shape"]:
    """Compute the penalty of errors in disparity.

    * ``"l1"``: ``|e|``;
    * ``"log"``: ``5 width log(1 + |e| / width)``, whose slope is 5 at zero and half of that at the
      width. It limits the effect of large errors: where nothing shows the disparity, no step
      reduces an error of several pixels, and its gradient is noise. The factor 5 keeps the penalty
      about as large as the error (equal at 0.27 with the default width), so that its weight
      relative to that of the distribution stays that of ``"l1"``;
    * ``"truncated"``: ``min(|e|, width)``. Errors above the width have no gradient.

    Args:
        error: Estimate minus ground truth, pixels per view step.
        kind: Name of the penalty.
        width: Error at which the slope of ``"log"`` is halved, or at which ``"truncated"`` becomes
            constant, pixels per view step.

    Returns:
        Penalties, of the same shape.

    Example:
        >>> penalty(jnp.array([-0.5, 2.0])).tolist()
        [0.5, 2.0]
    """
    size = jnp.abs(error)
    if kind == "l1":
        return size
    if kind == "log":
        return 5.0 * width * jnp.log1p(size / width)
    return jnp.minimum(size, width)


def inside_border(valid: Bool[Array, "h w"], border: int) -> Bool[Array, "h w"]:
    """Return the valid pixels that are at least ``border`` pixels away from each side."""
    h, w = valid.shape
    inside = jnp.zeros(valid.shape, bool).at[border : h - border, border : w - border].set(True)
    return valid & inside


def bad_pixels(
    disparity: Float[Array, "h w"],
    truth: Float[Array, "h w"],
    valid: Bool[Array, "h w"],
    border: int,
) -> WeightedSum:
    """Count 100 for each bad pixel: its error exceeds 0.07 pixels per view step.

    Pixels count if they are valid and at least ``border`` pixels away from each side.
    """
    bad = jnp.abs(disparity - truth) > BAD_PIXEL_THRESHOLD
    return weighted_sum(jnp.where(bad, 100.0, 0.0), inside_border(valid, border))
