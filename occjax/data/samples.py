"""The training example: a light field with its ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from occjax.errors import InputError
from occjax.view_selection import ViewSelection, select_from_grid


class LightFieldSample(NamedTuple):
    """One light field for training, or a batch of them with a leading axis on every field.

    Attributes:
        views: ``[v, u, h, w]`` grey views in [0, 1]; the centre view is ``[V // 2, U // 2]``.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view, in view
            steps; ``[1, n, 2]`` for selected views that form no grid, such as a star.
        disparity: ``[h, w]`` ground truth of the centre view, in pixels per view step.
        visibility: ``[v, u, h, w]`` whether each view sees the point that the centre view sees at
            that pixel; true everywhere if the visibility is unknown.
        valid: ``[h, w]`` pixels with ground truth.
    """

    views: Float[Array, "*b v u h w"]
    offsets: Float[Array, "*b v u 2"]
    disparity: Float[Array, "*b h w"]
    visibility: Bool[Array, "*b v u h w"]
    valid: Bool[Array, "*b h w"]


def numpy_sample(
    views: np.ndarray,
    offsets: np.ndarray,
    disparity: np.ndarray,
    *,
    visibility: np.ndarray | None = None,
    valid: np.ndarray | None = None,
) -> LightFieldSample:
    """Return a sample of NumPy arrays.

    Args:
        views: ``[v, u, h, w]`` grey views.
        offsets: ``[v, u, 2]`` offsets of the views.
        disparity: ``[h, w]`` ground truth, in pixels per view step.
        visibility: ``[v, u, h, w]``; None means unknown, which is true everywhere.
        valid: ``[h, w]``; None means that every pixel has ground truth.
    """
    # The fields are annotated as JAX arrays; Any permits NumPy arrays.
    fields: dict[str, Any] = {
        "views": views,
        "offsets": offsets,
        "disparity": disparity,
        "visibility": np.ones(views.shape, bool) if visibility is None else visibility,
        "valid": np.ones(disparity.shape, bool) if valid is None else valid,
    }
    return LightFieldSample(**fields)


def stack_samples(samples: Sequence[LightFieldSample]) -> LightFieldSample:
    """Stack samples of NumPy arrays into a batch of NumPy arrays.

    Raises:
        InputError: If the samples differ in the number or the size of their views.
    """
    if len({sample.views.shape for sample in samples}) != 1:
        shapes = sorted({str(list(sample.views.shape)) for sample in samples})
        raise InputError(
            f"light fields have views of {' and '.join(shapes)}; use the same crop and the same "
            "selection of views for all"
        )
    return LightFieldSample(*(np.stack(fields) for fields in zip(*samples, strict=True)))  # type: ignore[arg-type]


def to_device(sample: LightFieldSample) -> LightFieldSample:
    """Return the same sample or batch with JAX arrays."""
    return jax.tree.map(jnp.asarray, sample)


def select_views(sample: LightFieldSample, selection: ViewSelection) -> LightFieldSample:
    """Return the sample with some of its views.

    Args:
        sample: One sample (no batch axis) of NumPy or JAX arrays.
        selection: The views to take, see :func:`occjax.view_selection.select_from_grid`.

    Returns:
        The sample with views ``[V, U]`` for ``(V, U)`` of a grid, ``[1, n]`` for other selections.

    Raises:
        InputError: If the selection is invalid or the sample does not have its views.

    Example:
        >>> from occjax.lightfield import view_offsets
        >>> images = np.zeros((9, 9, 4, 6), np.float32)
        >>> sample = numpy_sample(images, view_offsets(9, 9), images[4, 4])
        >>> [select_views(sample, some).views.shape[:2] for some in ("star", "outer_star", (3, 5))]
        [(1, 33), (1, 17), (3, 5)]
    """
    if selection == "all":
        return sample
    indices = select_from_grid(np.asarray(sample.offsets), selection)
    return sample._replace(
        views=sample.views[indices],
        offsets=sample.offsets[indices],
        visibility=sample.visibility[indices],
    )
