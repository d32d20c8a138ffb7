"""Samples of NumPy arrays: what is read and cut on the host, before it is a batch on the device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from occjax.data.samples import Sample
from occjax.errors import InputError


def numpy_sample(
    views: np.ndarray,
    offsets: np.ndarray,
    disparity: np.ndarray,
    *,
    visibility: np.ndarray | None = None,
    valid: np.ndarray | None = None,
) -> Sample:
    """A sample of NumPy arrays.

    Args:
        views: ``[v, u, h, w]``.
        offsets: ``[v, u, 2]``.
        disparity: ``[h, w]``.
        visibility: ``[v, u, h, w]``; true everywhere by default, since it is not known.
        valid: ``[h, w]``; true everywhere by default.

    Returns:
        The sample.
    """
    # For the type checker a sample is of JAX arrays; functions that take both say so.
    fields: dict[str, Any] = {
        "views": views,
        "offsets": offsets,
        "disparity": disparity,
        "visibility": np.ones(views.shape, bool) if visibility is None else visibility,
        "valid": np.ones(disparity.shape, bool) if valid is None else valid,
    }
    return Sample(**fields)


def stack_samples(samples: Sequence[Sample]) -> Sample:
    """Samples of NumPy arrays as a batch of such.

    Args:
        samples: Of one shape.

    Returns:
        The batch.

    Raises:
        InputError: If their views differ in number or size.
    """
    if len({sample.views.shape for sample in samples}) != 1:
        shapes = sorted({str(list(sample.views.shape)) for sample in samples})
        raise InputError(
            f"light fields have views of {' and '.join(shapes)}; crop them, and select views, alike"
        )
    return Sample(*(np.stack(fields) for fields in zip(*samples, strict=True)))  # type: ignore[arg-type]


def to_device(sample: Sample) -> Sample:
    """The same sample or batch, of JAX arrays."""
    return jax.tree.map(jnp.asarray, sample)
