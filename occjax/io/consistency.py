"""Choice between interpretations of the views, or of the ground truth, by photo-consistency."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jax.scipy.ndimage import map_coordinates
from jaxtyping import Array, Float

from occjax.io.config import ReadingConfig
from occjax.io.maps import flipped_and_negated_maps
from occjax.layout import ViewOrderConfig
from occjax.layout.report import view_order_scores
from occjax.lightfield import LightField, centre_index, project, to_grey
from occjax.programs import kept


def most_consistent(candidates: Sequence[np.ndarray]) -> int:
    """Return the index of the most photo-consistent arrangement of the same views.

    Args:
        candidates: Views ``[V, U, H, W, C]`` in each arrangement.

    Returns:
        Index of the best arrangement; 0 unless another one is better by the factor
        ``clearly_worse_ratio`` of the default settings.

    Example:
        >>> wall = np.random.default_rng(0).random((60, 60, 1), np.float32)
        >>> views = np.stack([np.roll(wall, (-v, -u), (0, 1)) for v in range(3) for u in range(3)])
        >>> most_consistent([views[None], views.reshape(3, 3, 60, 60, 1)])
        1
    """
    config = ViewOrderConfig()
    scores = [min(view_order_scores(LightField(views), config).values()) for views in candidates]
    best = int(np.argmin(scores))
    return best if scores[0] > config.clearly_worse_ratio * scores[best] else 0


def ground_truth_mismatch(light_field: LightField) -> str | None:
    """Return what is wrong with the orientation or the sign of the ground truth.

    Args:
        light_field: Views with ground truth; at least two views.

    Returns:
        A description such as ``"its rows are reversed"``; None if the truth fits the views best
        unchanged.

    Example:
        >>> y, x = np.mgrid[:40, :40]
        >>> disparity = np.where(y < 16, 2, 0).astype(np.float32)
        >>> wall = np.random.default_rng(0).random((40, 40, 1))
        >>> views = np.stack([wall, wall[y, (x - disparity.astype(int)) % 40]])[None]
        >>> ground_truth_mismatch(LightField(views[:, ::-1], ground_truth=disparity[::-1]))
        'its rows are reversed'
    """
    truth = light_field.ground_truth
    assert truth is not None
    readings: dict[str | None, np.ndarray] = {None: truth}
    readings |= {
        f"its {words}": changed for words, changed in flipped_and_negated_maps(truth).items()
    }
    differences = {words: _truth_difference(light_field, d) for words, d in readings.items()}
    best = min(differences, key=differences.__getitem__)
    return best if differences[None] > ReadingConfig().min_truth_ratio * differences[best] else None


def _truth_difference(light_field: LightField, disparity: np.ndarray) -> float:
    """Return the mean grey difference between the centre view and its warped neighbours."""
    (rows, columns), (h, w) = light_field.grid, light_field.image_size
    v0, u0 = centre_index(light_field.grid)
    offsets = light_field.offsets
    step = max(1, min(h, w) // ReadingConfig().truth_samples)
    y, x = np.mgrid[0:h:step, 0:w:step]
    centre, d = to_grey(light_field.centre)[y, x], disparity[y, x].astype(np.float64)
    differences = []
    for v, u in ((v0 - 1, u0), (v0 + 1, u0), (v0, u0 - 1), (v0, u0 + 1)):
        if 0 <= v < rows and 0 <= u < columns:
            positions = np.asarray(project(y, x, np.nan_to_num(d), offsets[v, u]), np.float32)
            warped = np.asarray(_sample_bilinear(to_grey(light_field.views[v, u]), positions))
            differences.append(np.abs(warped - centre)[np.isfinite(d)].mean())
    return float(np.mean(differences))


@kept
def _sample_bilinear(
    image: Float[Array, "h w"], positions: Float[Array, "2 rows columns"]
) -> Float[Array, "rows columns"]:
    """Sample an image bilinearly at positions ``(y, x)``; borders replicated."""
    return map_coordinates(image, list(positions), order=1, mode="nearest")
