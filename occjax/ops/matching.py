"""Matching without learning: how well the views agree at each disparity candidate.

:func:`sector_sums` and :func:`aperture_costs` compare the views, :func:`semi_global` carries the
costs along straight paths across the image.

An occluder hides a point from some views, and it hides it from views on one side together. So the
views are split into eight sectors by the direction from the centre view, and each pixel takes the
part of the aperture that agrees best: a half (five neighbouring sectors, the outer two counted
half) sees past a straight occluding edge, a quarter (three sectors) past a corner.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from functools import partial
from typing import Literal, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from occjax.ops.aperture import SECTORS, views_around
from occjax.ops.filtering import (
    BINOMIAL_CORRELATION,
    BINOMIAL_GAIN,
    binomial_filter,
    box_filter,
    central_differences,
)
from occjax.ops.noise import (
    expected_departure,
    interpolation_gain,
    noise_level,
    texture_share,
)
from occjax.ops.planes import least_plane, sum_planes
from occjax.ops.sampling import as_coordinates, as_images

Aperture = Literal["half", "quarter"]
T = TypeVar("T")


def sector_sums(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    *,
    truncation: Float[Array, " c"],
    combine: Callable[[Float[Array, "8 h w"], Float[Array, " 8"]], T],
    noise: Float[Array, " c"] | None = None,
    correlation: Float[Array, "c 2"] | None = None,
    offsets: Float[Array, "v u 2"] | None = None,
) -> T:
    """Truncated absolute differences to the centre view, summed in each sector of the aperture.

    For the view k shifted by candidate d,
    ``e_k = mean_c min(|feature_k - feature_centre| / truncation_c, 1)``. Borders are replicated.
    Time is O(v u d h w c); memory is that of the padded features and of what is kept.

    Args:
        features: ``[v, u, h, w, c]`` views or features of them, for example grey and its gradients.
        candidates: ``[d]`` disparities, pixels per view step.
        truncation: ``[c]`` difference of each feature that counts as "something else", so that
            highlights and occluders are not followed.
        combine: What to keep of one candidate, given the sums ``[8, h, w]`` of ``e_k`` and the
            number ``[8]`` of views in each sector (:func:`occjax.ops.sector_of`).
        noise: ``[c]`` standard deviation of each feature's noise. To each
            ``|feature_k - feature_centre|`` it adds what the mean difference lost because view k
            was read between pixels, which averages noise; without it, noisy images favour the
            candidates that read between pixels.
        correlation: ``[c, 2]`` of each feature's noise at neighbouring pixels ``(down a column,
            along a row)``; none by default. The more alike they are, the less is averaged.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        What ``combine`` returns, with an axis of candidates before all others.

    Raises:
        InputError: If there is no view beside the centre view, or for integer features.

    Example:
        >>> views = jnp.zeros((3, 3, 8, 8, 1)).at[0].set(1.0)  # the upper row differs
        >>> kept = sector_sums(
        ...     views, jnp.zeros(2), truncation=jnp.ones(1), combine=lambda sums, numbers: sums
        ... )
        >>> kept[1, :, 4, 4].tolist()
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
    """
    features = as_images(features, "v u h w c", "features")
    v, u, h, w, c = features.shape
    around = views_around((v, u), offsets)
    planes = jnp.moveaxis(features.reshape(v * u, h, w, c), -1, 1)
    centre = planes[around.centre]
    margin = max(h, w) // 4 + 1
    # Padded once for all shifts. A view shifted by more than the margin is not compared honestly,
    # but it would show little of the image.
    padded = jnp.pad(
        planes, ((0, 0), (0, 0), (margin, margin + 1), (margin, margin + 1)), mode="edge"
    )
    candidates, displacements = as_coordinates(candidates, -around.offset)
    scale = jnp.where(around.present[:, None], 1 / (c * truncation[None]), 0.0).astype(
        features.dtype
    )
    nothing = jnp.zeros((h, w), features.dtype)
    if noise is None:
        noise = jnp.zeros_like(truncation)
    if correlation is None:
        correlation = jnp.zeros((c, 2), truncation.dtype)

    @jax.checkpoint
    def plane(candidate):
        averaged = _averaged_noise(noise, truncation, candidate * displacements, correlation)

        def add_view(sums, step):
            view, sector, displacement, scale, averaged = step
            departures = nothing
            for channel in range(c):
                shifted = _shift(
                    padded, (view, np.int32(channel)), candidate * displacement, margin
                )
                difference = jnp.abs(shifted - centre[channel])
                departure = (difference + averaged[channel]) * scale[channel]
                departures = departures + jnp.minimum(departure, 1 / c)
            return sums.at[sector].add(departures), None

        terms = (around.view, around.sector, displacements, scale, averaged)
        sums, _ = jax.lax.scan(add_view, jnp.stack([nothing] * SECTORS), terms)
        return combine(sums, around.numbers.astype(features.dtype))

    return jax.lax.map(plane, candidates)


def aperture_costs(
    features: Float[Array, "v u h w c"],
    candidates: Float[Array, " d"],
    *,
    truncation: Float[Array, " c"],
    aperture: Aperture = "quarter",
    noise: Float[Array, " c"] | None = None,
    radius: int = 1,
    offsets: Float[Array, "v u 2"] | None = None,
) -> Float[Array, "d h w"]:
    """Truncated absolute differences to the centre view, over the best part of the aperture.

    The cost of a candidate is the least of the mean of the ``e_k`` of :func:`sector_sums` over all
    views and of its means over the eight parts of the aperture.

    Args:
        features: ``[v, u, h, w, c]`` views or features of them, for example grey and its gradients.
        candidates: ``[d]`` disparities, pixels per view step.
        truncation: ``[c]`` difference of each feature that counts as "something else".
        aperture: What is compared beside the whole aperture: its eight halves or eight quarters.
        noise: ``[c]`` standard deviation of each feature's noise, as for :func:`sector_sums`.
        radius: Radius of the window over which ``e_k`` is averaged before the best part is chosen,
            in pixels; without it noise makes the choice.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        ``[d, h, w]`` costs in [0, 1].

    Raises:
        InputError: If there is no view beside the centre view, or for integer features.

    Example:
        >>> ramp = jnp.tile(jnp.arange(8.0)[None, :, None], (8, 1, 1))
        >>> views = jnp.stack([ramp - 1.0, ramp, ramp + 1.0])[None]  # disparity 1
        >>> candidates = jnp.array([-1.0, 0.0, 1.0])
        >>> aperture_costs(views, candidates, truncation=jnp.array([4.0]))[:, 4, 4].tolist()
        [0.5, 0.25, 0.0]
    """
    return sector_sums(
        features,
        candidates,
        truncation=truncation,
        noise=noise,
        offsets=offsets,
        combine=lambda sums, numbers: best_part(box_filter(sums, radius), numbers, aperture),
    )


def grey_costs(
    views: Float[Array, "v u h w"],
    candidates: Float[Array, " d"],
    *,
    grey_truncation: float,
    derivative_truncation: float,
    blurred_truncation: float = 0.003,
    noise: Float[Array, ""] | None = None,
    offsets: Float[Array, "v u 2"] | None = None,
) -> Float[Array, "d h w"]:
    """Costs of grey and its derivatives; of blurred grey where noise hides the texture.

    Derivatives do not see vignetting and the broad part of highlights, and are what tells weakly
    textured surfaces apart: :func:`aperture_costs` of grey and both derivatives. Noise is allowed
    for: where it alone is beyond a truncation, all candidates would be alike, so that the
    truncation is the root of the sum of squares of both.

    Where the derivatives are noise alone (:func:`occjax.ops.texture_share`) they say nothing, and
    the best part of the aperture is that whose noise is least. What is left there is broad: the
    mean over the whole aperture of the truncated absolute differences of grey, after
    :func:`occjax.ops.binomial_filter`.

    Args:
        views: ``[v, u, h, w]`` grey views, the white of the centre view at about 0.8.
        candidates: ``[d]`` disparities, pixels per view step.
        grey_truncation: Difference of grey that counts as "something else".
        derivative_truncation: The same of its derivatives, per pixel.
        blurred_truncation: The same of blurred grey.
        noise: Standard deviation of the noise of grey; :func:`occjax.ops.noise_level` by default.
        offsets: ``[v, u, 2]`` offset ``(row, column)`` of each view from the centre view; a regular
            grid by default.

    Returns:
        ``[d, h, w]`` costs in [0, 1].

    Raises:
        InputError: If there is no view beside the centre view, or for integer views.

    Example:
        >>> ramp = jnp.tile(jnp.arange(8.0)[None, :, None], (8, 1, 1))
        >>> views = jnp.stack([ramp - 1.0, ramp, ramp + 1.0])[None, ..., 0]  # disparity 1
        >>> options = {"grey_truncation": 4.0, "derivative_truncation": 1.0}
        >>> costs = grey_costs(views, jnp.array([-1.0, 0.0, 1.0]), **options)
        >>> costs[:, 4, 4].argmin().tolist()
        2
    """
    views = as_images(views, "v u h w")
    v, u = views.shape[:2]
    if noise is None:
        noise = noise_level(views, candidates, offsets=offsets)
    # A central difference, half of that of two pixels, has half the variance.
    of_each = noise * jnp.sqrt(jnp.array([1.0, 0.5, 0.5], views.dtype))
    truncation = jnp.array(
        [grey_truncation, derivative_truncation, derivative_truncation], views.dtype
    )
    fine = aperture_costs(
        jnp.stack([views, *central_differences(views)], axis=-1),
        candidates,
        truncation=jnp.hypot(truncation, of_each),
        noise=of_each,
        offsets=offsets,
    )
    blurred = BINOMIAL_GAIN * noise[None]
    broad = sector_sums(
        binomial_filter(views)[..., None],
        candidates,
        truncation=jnp.hypot(jnp.array([blurred_truncation], views.dtype), blurred),
        noise=blurred,
        correlation=jnp.full((1, 2), BINOMIAL_CORRELATION, views.dtype),
        offsets=offsets,
        combine=lambda sums, numbers: box_filter(sum_planes(sums) / numbers.sum(), 1),
    )
    share = texture_share(views[v // 2, u // 2], noise)[None]
    return share * fine + (1 - share) * broad


def best_part(
    sums: Float[Array, "8 h w"], numbers: Float[Array, " 8"], aperture: Aperture = "quarter"
) -> Float[Array, "h w"]:
    """Least of the means over all views and over each part of the aperture.

    Args:
        sums: ``[8, h, w]`` sum of something over the views of each sector.
        numbers: ``[8]`` of these views.
        aperture: The parts: its eight halves or eight quarters.

    Returns:
        ``[h, w]``; parts without views do not count.

    Example:
        >>> sums = jnp.ones((8, 1, 1)).at[1:4].set(0.0)
        >>> float(best_part(sums, jnp.ones(8))[0, 0])
        0.0
    """
    parts = _parts(aperture)
    views = jnp.tensordot(jnp.asarray(parts, sums.dtype), numbers, 1, precision="highest")
    # A quarter of a grid of one row may be empty.
    empty = jnp.where(views > 0, 0.0, jnp.inf).astype(sums.dtype)
    shares = 1 / jnp.maximum(views, 1e-9)

    def mean(part: int) -> Float[Array, "h w"]:
        # Written out, all parts are one pass over memory.
        shared = (float(share) * sums[sector] for sector, share in enumerate(parts[part]) if share)
        return sum(shared, jnp.zeros_like(sums[0])) * shares[part] + empty[part]

    return functools.reduce(jnp.minimum, map(mean, range(len(parts))))


def semi_global(
    costs: Float[Array, "d h w"],
    guide: Float[Array, "h w"],
    *,
    small_penalty: Float[Array, ""] | float,
    large_penalty: Float[Array, ""] | float,
    guide_scale: float,
) -> Float[Array, "d h w"]:
    """Aggregate a cost volume along eight straight paths into each pixel.

    Semi-global matching (Hirschmueller, Stereo Processing by Semiglobal Matching and Mutual
    Information, TPAMI 2008). The cost of candidate k at pixel p along a path is its own cost plus
    the cheapest way to come from the pixel q before::

        L(p, k) = C(p, k) - min L(q)
                + min(L(q, k), L(q, k - 1) + P1, L(q, k + 1) + P1, min L(q) + P2)

    with ``P2 = max(P1, large_penalty * exp(-|guide(p) - guide(q)| / guide_scale))``: disparity may
    jump where the guide does. The result is the mean over the paths, so its scale is that of the
    costs accumulated over a neighbourhood. Time is O(d h w) and memory that of a few volumes.

    Args:
        costs: ``[d, h, w]`` cost of each candidate, candidates in increasing order.
        guide: ``[h, w]`` image of the centre view.
        small_penalty: P1, for a step to a neighbouring candidate (slanted surfaces).
        large_penalty: Upper bound of P2, for any larger step (depth edges).
        guide_scale: Difference of the guide over which P2 falls by a factor e.

    Returns:
        ``[d, h, w]`` aggregated costs.

    Example:
        >>> noisy = jnp.array([[0.0, 0.0, 0.3, 0.0, 0.0], [0.2, 0.2, 0.2, 0.2, 0.2]])[:, None]
        >>> smooth = semi_global(
        ...     noisy, jnp.zeros((1, 5)), small_penalty=0.5, large_penalty=1.0, guide_scale=0.1
        ... )
        >>> noisy.argmin(0)[0].tolist(), smooth.argmin(0)[0].tolist()
        ([0, 0, 1, 0, 0], [0, 0, 0, 0, 0])
    """
    step = partial(
        _arrive,
        small=jnp.asarray(small_penalty, costs.dtype),
        large=jnp.asarray(large_penalty, costs.dtype),
        guide_scale=guide_scale,
    )
    by_row, by_column = jnp.moveaxis(costs, 0, 1), jnp.moveaxis(costs, 2, 0)

    def paths(along_rows: Callable) -> Array:
        down = along_rows(by_row, guide, step, (0, 1, -1))
        across = along_rows(by_column, guide.T, step, (0,))
        return jnp.moveaxis(down, 1, 0) + jnp.moveaxis(across, 0, 2)

    one_by_one, at_once = (partial(paths, each) for each in (_one_by_one, _at_once))
    return jax.lax.platform_dependent(cpu=one_by_one, default=at_once) / 8


def _shift(padded: Array, plane: tuple[Array, np.int32], displacement: Array, margin: int) -> Array:
    """``[h, w]`` one plane of the padded ``[k, c, ...]``, read at a displacement, bilinear.

    Unlike :func:`occjax.ops.shift` it reads an array that was padded once for all candidates: four
    slices and their weighted sum fuse into a single pass over memory.
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


def _averaged_noise(
    noise: Array, truncation: Array, displacements: Array, correlation: Array
) -> Array:
    """``[n, c]`` mean truncated difference that averaging by interpolation takes from noise."""

    def left(displacement: Array) -> Array:
        gain = interpolation_gain(jnp.broadcast_to(displacement, correlation.shape), correlation)
        return expected_departure(noise * jnp.sqrt(1 + gain).astype(noise.dtype), truncation)

    whole = expected_departure(noise * np.sqrt(2).item(), truncation)
    return whole[None] - jax.vmap(left)(displacements)


def _parts(aperture: Aperture) -> np.ndarray:
    """``[1 + 8, 8]`` how far each sector belongs to the whole, and to each part of the aperture."""
    reach = 2 if aperture == "half" else 1
    turn = (np.arange(SECTORS)[:, None] - np.arange(SECTORS)[None, :]) % SECTORS
    distance = np.minimum(turn, SECTORS - turn)
    parts = np.where(distance < reach, 1.0, np.where(distance == reach, 0.5, 0.0))
    return np.concatenate([np.ones((1, SECTORS)), parts])


def _one_by_one(
    costs: Float[Array, "y d x"],
    guide: Float[Array, "y x"],
    step: Callable[..., Array],
    slopes: tuple[int, ...],
) -> Float[Array, "y d x"]:
    """Sum of the path costs of both directions of each slope, one path after the other.

    Paths move one row, and ``slope`` columns, at each step. On a CPU in 0.7 of the time of
    :func:`_at_once`.
    """

    def along_rows(slope: int, reverse: bool) -> Array:
        def row(before, here):
            path = step(*before, *here, slope=slope)
            return (path, here[1]), path

        start = (jnp.zeros_like(costs[0]), guide[-1] if reverse else guide[0])
        return jax.lax.scan(row, start, (costs, guide), reverse=reverse)[1]

    total = jnp.zeros_like(costs)
    for slope in slopes:
        for reverse in (False, True):
            total = total + along_rows(slope, reverse)
    return total


def _at_once(
    costs: Float[Array, "y d x"],
    guide: Float[Array, "y x"],
    step: Callable[..., Array],
    slopes: tuple[int, ...],
) -> Float[Array, "y d x"]:
    """The same row after row: of few large steps, which is what a GPU is quick at."""

    def both_ways(rows: Array) -> Array:
        return jnp.stack([rows, rows[::-1]], axis=1)

    def row(before: tuple[Array, Array], here: tuple[Array, Array]):
        paths, guide_before = before
        cost, guide_here = here
        moved = [
            jax.vmap(partial(step, slope=slope))(path, guide_before, cost, guide_here)
            for path, slope in zip(paths, slopes, strict=True)
        ]
        paths = jnp.stack(moved)
        return (paths, guide_here), paths.sum(0)

    guides = both_ways(guide)
    nothing = jnp.zeros((len(slopes), 2, *costs.shape[1:]), costs.dtype)
    found = jax.lax.scan(row, (nothing, guides[0]), (both_ways(costs), guides))[1]
    return found[:, 0] + found[::-1, 1]


def _arrive(
    path: Float[Array, "d x"],
    guide_before: Float[Array, " x"],
    cost: Float[Array, "d x"],
    guide_here: Float[Array, " x"],
    *,
    slope: int,
    small: Array,
    large: Array,
    guide_scale: float,
) -> Float[Array, "d x"]:
    """Path costs of a row from those of the row before."""
    beyond = jnp.full((1, cost.shape[1]), jnp.inf, cost.dtype)
    if slope:
        # A path that enters through the image's side starts there, with nothing accumulated.
        entry = 0 if slope > 0 else -1
        path = jnp.roll(path, slope, axis=1).at[:, entry].set(0.0)
        guide_before = jnp.roll(guide_before, slope)
    jump = jnp.maximum(small, large * jnp.exp(-jnp.abs(guide_here - guide_before) / guide_scale))
    cheapest = least_plane(path)[None]
    neighbour = jnp.minimum(
        jnp.concatenate([path[1:], beyond]), jnp.concatenate([beyond, path[:-1]])
    )
    arrival = jnp.minimum(jnp.minimum(path, neighbour + small), cheapest + jump[None])
    return cost + arrival - cheapest
