"""Strips of image rows, which bound the memory of an estimate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from occjax.models.proposal import ProposalNetConfig


@dataclass(frozen=True)
class StripConfig:
    """Settings of the strips; the bytes were measured on compiled programs.

    Attributes:
        max_bytes: Memory of an estimate above which it is computed in strips.
        candidate_bytes: Bytes per pixel of the search and candidate.
        view_bytes: Bytes per pixel of the search and view.
        selector_bytes: Bytes per pixel of the selection.
        context_rows: Rows of the margin above and below a strip, in addition to the largest motion
            between views.
    """

    max_bytes: int = 3 * 2**30
    candidate_bytes: int = 40
    view_bytes: int = 80
    selector_bytes: int = 2300
    context_rows: int = 44


class Strips(NamedTuple):
    """Overlapping strips of rows.

    Attributes:
        rows: ``[s, n]`` rows of each strip.
        sources: ``[2, h]`` strip, and row within the strip, that each row of the result is taken
            from.
    """

    rows: Int[Array | np.ndarray, "s n"]
    sources: Int[Array | np.ndarray, "2 h"]


def plan_strips(
    image_size: tuple[int, int],
    views: int,
    candidates: int,
    motion: float,
    network: ProposalNetConfig,
    config: StripConfig = StripConfig(),
) -> Strips | None:
    """Divide an image into strips if its estimate as a whole would take too much memory.

    A strip is computed with a margin of rows above and below. It is at least as high as one margin,
    so that the time is at most about three times that of the whole image.

    Args:
        image_size: ``(h, w)`` in pixels.
        views: Number of views.
        candidates: Number of disparity candidates.
        motion: Largest motion along columns between the centre view and another one, in pixels.
        network: Configuration of the network.
        config: Settings.

    Returns:
        The strips; None if the whole image fits.

    Example:
        >>> plan_strips((512, 512), 17, 30, 20.0, ProposalNetConfig())
        >>> plan_strips((2000, 1500), 17, 30, 20.0, ProposalNetConfig()).rows.shape
        (4, 628)
    """
    h, w = image_size
    bytes_per_pixel = config.candidate_bytes * candidates + config.view_bytes * views
    bytes_per_pixel //= network.search.downsampling**2
    if network.selector is not None:
        bytes_per_pixel += config.selector_bytes
    max_rows = config.max_bytes // (bytes_per_pixel * w)
    if h <= max_rows:
        return None
    margin = int(np.ceil(motion)) + config.context_rows
    kept = max(max_rows - 2 * margin, margin)
    count = -(-h // kept)
    kept = -(-h // count)
    height = min(kept + 2 * margin, h)
    starts = np.clip(kept * np.arange(count) - margin, 0, h - height)
    rows = starts[:, None] + np.arange(height)
    strip = np.arange(h) // kept
    return Strips(rows.astype(np.int32), np.stack([strip, np.arange(h) - starts[strip]]))


def map_strips(
    function: Callable[[Any], Any],
    images: Any,
    strips: Strips,
) -> Any:
    """Apply a function of images to one strip after the other.

    Args:
        function: Function that returns maps ``[n, w]`` of images ``[..., n, w]``.
        images: Images ``[..., h, w]``, or a pytree of them.
        strips: The strips.

    Returns:
        The maps ``[h, w]``.

    Example:
        >>> rows, sources = [[0, 1, 2], [1, 2, 3]], [[0, 0, 1, 1], [0, 1, 1, 2]]
        >>> strips = Strips(np.array(rows), np.array(sources))
        >>> views = jnp.arange(8.0).reshape(1, 1, 4, 2)
        >>> map_strips(lambda part: part[0, 0], views, strips)[:, 0].tolist()
        [0.0, 2.0, 4.0, 6.0]
    """
    strip, row = strips.sources

    def strip_maps(rows: Array) -> Any:
        return function(jax.tree.map(lambda image: image[..., rows, :], images))

    maps = jax.lax.map(strip_maps, jnp.asarray(strips.rows))
    return jax.tree.map(lambda parts: parts[strip, row], maps)
