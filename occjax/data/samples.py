"""A training example: a light field with what is known about it."""

from __future__ import annotations

from typing import NamedTuple

from jaxtyping import Array, Bool, Float


class Sample(NamedTuple):
    """One light field for training, or a batch of them with a leading axis on every field.

    Attributes:
        views: ``[v, u, h, w]`` grey views in [0, 1]; the centre view is ``[V // 2, U // 2]``.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in view
            steps. They need not be those of a full grid: the views of a crosshair or a star are
            ``[1, n]``.
        disparity: ``[h, w]`` of the centre view, pixels per view step.
        visibility: ``[v, u, h, w]`` whether each view sees the point that the centre view sees at
            that pixel; true everywhere where that is not known.
        valid: ``[h, w]`` pixels whose ground truth counts.
    """

    views: Float[Array, "*b v u h w"]
    offsets: Float[Array, "*b v u 2"]
    disparity: Float[Array, "*b h w"]
    visibility: Bool[Array, "*b v u h w"]
    valid: Bool[Array, "*b h w"]
