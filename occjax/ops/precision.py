"""Formulas of this package in double precision, whatever JAX is set to."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import jax
import numpy as np

from occjax.lightfield import Calibration


def in_double(
    function: Callable[[jax.Array, Calibration], jax.Array],
    values: np.ndarray,
    calibration: Calibration,
) -> np.ndarray:
    """A formula of a map and its camera, computed in double precision.

    Depth and normals are differences of nearly equal numbers: of inverse depths, and of
    neighbouring points.

    Args:
        function: The formula. Compiled once for each function, camera and shape.
        values: ``[...]`` the map.
        calibration: Camera parameters.

    Returns:
        What the function returns, as float64.

    Example:
        >>> from occjax.ops import depth_from_disparity
        >>> camera = Calibration(100.0, 35.0, baseline_mm=50.0, focus_distance_m=4.0)
        >>> in_double(depth_from_disparity, np.zeros((1, 1), np.float32), camera).dtype
        dtype('float64')
    """
    with jax.enable_x64(True):
        return np.asarray(_compiled(function, np.asarray(values, np.float64), calibration))


@partial(jax.jit, static_argnums=(0, 2))
def _compiled(function: Callable, values: jax.Array, calibration: Calibration) -> jax.Array:
    return function(values, calibration)
