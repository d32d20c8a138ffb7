"""Matching costs without learning: how well the views agree at each disparity candidate.

An occluder hides a point from some views, and it hides it from views on one side together. So the
views are split into eight sectors by the direction from the centre view, and each pixel takes the
half of the aperture (five neighbouring sectors, the outer two counted half) that agrees best: at a
straight occluding edge one half sees past it.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.errors import InputError
from occjax.ops.geometry import view_offsets

SECTORS = 8


def half_aperture_costs(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    *,
    truncation: Float[Array, " c"],
    offsets: Float[Array, "v u 2"] | None = None,
) -> Float[Array, "d h w"]:
    """Truncated absolute differences to the centre view, over the best half of the aperture.

    For the view k shifted by candidate d,
    ``e_k = mean_c min(|feature_k - feature_centre| / truncation_c, 1)``; the cost is the least of
    the mean of ``e_k`` over all views and its means over eight half apertures. Borders are
    replicated. Time is O(v u d h w c); memory is that of the padded features and the result.

    Args:
        features: ``[v, u, h, w, c]`` views or features of them, for example grey and its gradients.
        candidates: ``[d]`` disparities, pixels per view step.
        truncation: ``[c]`` difference of each feature that counts as "something else", so that
            highlights and occluders are not followed.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default. Sectors go by the place in the grid.

    Returns:
        ``[d, h, w]`` costs in [0, 1].

    Raises:
        InputError: If there is no view beside the centre view.

    Example:
        >>> ramp = jnp.tile(jnp.arange(8.0)[None, :, None], (8, 1, 1))
        >>> views = jnp.stack([ramp - 1.0, ramp, ramp + 1.0])[None]  # disparity 1
        >>> candidates = jnp.array([-1.0, 0.0, 1.0])
        >>> half_aperture_costs(views, candidates, truncation=jnp.array([4.0]))[:, 4, 4].tolist()
        [0.5, 0.25, 0.0]
    """
    v, u, h, w, c = features.shape
    if offsets is None:
        offsets = view_offsets(v, u)
    others, sectors = _sectors(v, u)
    halves = jnp.asarray(_half_apertures(sectors), features.dtype)
    planes = jnp.moveaxis(features.reshape(v * u, h, w, c), -1, 1)
    centre = planes[(v // 2) * u + u // 2]
    margin = max(h, w) // 4 + 1
    # Padded once for all shifts. A view shifted by more than the margin is not compared honestly,
    # but it would show little of the image.
    padded = jnp.pad(
        planes, ((0, 0), (0, 0), (margin, margin + 1), (margin, margin + 1)), mode="edge"
    )
    # One step for each feature of each view: a single pass over memory, whatever c is.
    view, channel = (jnp.asarray(index.ravel()) for index in np.meshgrid(others, np.arange(c)))
    sector = jnp.asarray(np.tile(sectors, c))
    displacements = -offsets.reshape(-1, 2)[view]
    scale = (1 / (c * truncation)).astype(features.dtype)[channel]

    @jax.checkpoint
    def plane(candidate):
        def add_feature(sums, step):
            view, channel, sector, displacement, scale = step
            shifted = _shift(padded, (view, channel), candidate * displacement, margin)
            departure = jnp.abs(shifted - centre[channel]) * scale
            return sums.at[sector].add(jnp.minimum(departure, 1 / c)), None

        start = jnp.zeros((SECTORS, h, w), features.dtype)
        sums, _ = jax.lax.scan(add_feature, start, (view, channel, sector, displacements, scale))
        return jnp.tensordot(halves, sums, 1, precision="highest").min(0)

    return jax.lax.map(plane, candidates)


def _shift(padded: Array, plane: tuple[Array, Array], displacement: Array, margin: int) -> Array:
    """``[h, w]`` one plane of the padded ``[k, c, ...]``, read at a displacement, bilinear.

    Four slices of one array and their weighted sum fuse into a single pass over memory, which
    :func:`occjax.ops.shift` with its padding at each call does not: this takes a tenth of its time.
    """
    size = (1, 1, padded.shape[2] - 2 * margin - 1, padded.shape[3] - 2 * margin - 1)
    displacement = jnp.clip(displacement, -margin, margin)
    whole = jax.lax.stop_gradient(jnp.floor(displacement))
    fraction_row, fraction_column = (displacement - whole).astype(padded.dtype)
    row, column = whole.astype(jnp.int32) + margin

    def tap(down, right):
        return jax.lax.dynamic_slice(padded, (*plane, row + down, column + right), size)[0, 0]

    left = tap(0, 0) * (1 - fraction_row) + tap(1, 0) * fraction_row
    right = tap(0, 1) * (1 - fraction_row) + tap(1, 1) * fraction_row
    return left * (1 - fraction_column) + right * fraction_column


def _sectors(v: int, u: int) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices of the views beside the centre one, and the sector (0 to 7) of each."""
    rows, columns = np.meshgrid(np.arange(v) - v // 2, np.arange(u) - u // 2, indexing="ij")
    others = np.flatnonzero((rows != 0) | (columns != 0))
    if not len(others):
        raise InputError("one view has no disparity: give a grid of at least 1x2 views")
    angle = np.arctan2(rows, columns).ravel()[others]
    return others, np.round(angle * SECTORS / (2 * np.pi)).astype(int) % SECTORS


def _half_apertures(sectors: np.ndarray) -> np.ndarray:
    """``[1 + 8, 8]`` weights turning sums over sectors into means: all views, then the halves."""
    turn = (np.arange(SECTORS)[:, None] - np.arange(SECTORS)[None, :]) % SECTORS
    distance = np.minimum(turn, SECTORS - turn)
    halves = np.where(distance < 2, 1.0, np.where(distance == 2, 0.5, 0.0))
    apertures = np.concatenate([np.ones((1, SECTORS)), halves])
    views = apertures @ np.bincount(sectors, minlength=SECTORS)
    seen = views > 0  # a half of a grid of two rows may be empty
    return apertures[seen] / views[seen, None]
