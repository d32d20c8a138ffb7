"""Shift and camera position of each view, measured against the disparity map of the centre view.

View ``k`` shows the point ``x`` of the centre view at ``x - d(x) p_k + s_k``. In a regular grid
``p_k`` is the offset of the view in the grid and the shift ``s_k`` is zero. A rotated camera or a
wrong crop changes ``s_k``, a camera that is not where it should be changes ``p_k``.

Lucas-Kanade steps on reduced images, from coarse to fine, alternate: they improve all ``s_k`` and
``p_k`` for a fixed disparity map, then the disparity map for fixed ``s_k`` and ``p_k``. Two changes
of all views at once are equivalent to a change of the disparity map and are not measured: shifts in
proportion to ``p_k`` (a constant added to the disparity) and a common factor of all ``p_k``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.ndimage import map_coordinates
from jaxtyping import Array, Float, Int

from occjax.kernels.bilinear import project_pixels
from occjax.kernels.median import median_filter
from occjax.layout.brightness import ViewBrightness
from occjax.layout.config import RegistrationConfig, ViewOrderConfig
from occjax.layout.filters import box_mean, high_pass, reduce_image
from occjax.lightfield import (
    LightField,
    centre_index,
    grid_around,
    positions_around,
    view_offsets,
)
from occjax.programs import kept


@dataclass(frozen=True, eq=False)
class Registration:
    """Corrections that make the views of a light field consistent.

    Attributes:
        spacing: Spacing of the view columns in steps of the view rows; 1 in an ordinary grid.
        positions: ``[V, U, 2]`` float32 measured camera positions ``(row, column)``, in steps of
            the view rows, relative to the centre view; None if those of the light field agree.
        shifts: ``[V, U, 2]`` float32 displacement ``(down, right)`` of the content of each view, in
            pixels of the light field; None if no view is clearly shifted.
        moved: ``[V, U]`` bool, views whose camera is not at its place in the grid.
    """

    spacing: float
    positions: np.ndarray | None
    shifts: np.ndarray | None
    moved: np.ndarray

    @property
    def notes(self) -> tuple[str, ...]:
        """Messages for the user, one for each kind of correction.

        Example:
            >>> moved = np.zeros((1, 2), bool)
            >>> Registration(1.0, None, np.array([[[0.0, 0.0], [0.0, 1.5]]]), moved).notes
            ('view (0, 1) is shifted against the grid by up to 1.5 pixels; the shift is undone',)
        """
        notes = []
        if self.spacing != 1.0:
            notes.append(
                f"the view columns are {self.spacing:.3g} times as far apart as the view rows, "
                "measured; disparity is per row step; --spacing ROWS COLUMNS declares it"
            )
        if self.moved.any():
            notes.append(
                f"{_views(self.moved)} taken from other places than those of the grid; the "
                "measured camera positions are used"
            )
        if self.shifts is not None:
            size = np.abs(self.shifts).max(-1)
            notes.append(
                f"{_views(size > 0)} shifted against the grid by up to {size.max():.2g} pixels; "
                "the shift is undone"
            )
        return tuple(notes)

    @property
    def misplaced(self) -> np.ndarray:
        """``[V, U]`` bool, views nearer to another place of the regular grid than to their own.

        Example:
            >>> positions = np.array([[[0.0, -1.2], [0.0, 0.0], [0.0, -0.9]]])
            >>> Registration(1.0, positions, None, np.zeros((1, 3), bool)).misplaced.tolist()
            [[False, False, True]]
        """
        if self.positions is None:
            return np.zeros(self.moved.shape, bool)
        regular = view_offsets(*self.moved.shape, column_spacing=self.spacing)
        steps = np.abs(self.positions - regular) / [1.0, self.spacing]
        return steps.max(-1) > 0.5

    def apply(self, light_field: LightField) -> LightField:
        """Return the light field with the measured positions and with the shifts undone.

        Views that are not shifted, and the centre view, keep their values. The view order report is
        dropped.
        """
        positions = light_field.positions if self.positions is None else self.positions
        views = light_field.views
        if self.shifts is not None:
            views = views.copy()
            for index in zip(*np.nonzero(self.shifts.any(-1)), strict=True):
                views[index] = _shifted_back(light_field.views[index], self.shifts[index])
        return replace(light_field, views=views, positions=positions, view_order_report=None)

    def around(self, view: tuple[int, int]) -> Registration:
        """Return the corrections relative to another view, which becomes the centre view.

        Args:
            view: ``(v, u)``, index of that view. Its content is not moved; that of the others is
                moved to fit.
        """
        positions, shifts = self.positions, self.shifts
        if shifts is not None:
            shifts = grid_around(shifts - shifts[view], view)
        return Registration(
            self.spacing,
            None if positions is None else positions_around(positions, view),
            shifts,
            grid_around(self.moved, view),
        )


def _views(chosen: np.ndarray) -> str:
    """Name the chosen views of ``[V, U]`` if they are few, else count them."""
    names = [f"({v}, {u})" for v, u in np.argwhere(chosen)]
    if len(names) > 4:
        return f"{len(names)} of {chosen.size} views are"
    return f"view{'s' * (len(names) > 1)} {', '.join(names)} {'are' if len(names) > 1 else 'is'}"


@dataclass(frozen=True)
class _State:
    """Estimate in pixels of reduced images: disparity ``[h, w]``, positions and shifts ``[n, 2]``.

    ``error`` is the ``[n, 2]`` standard error of the shifts, ``loss`` the ``[n]`` loss of the views
    (:func:`_normal_equations`).
    """

    disparity: np.ndarray
    positions: np.ndarray
    shifts: np.ndarray
    error: np.ndarray
    loss: np.ndarray

    def at(self, size: tuple[int, ...]) -> _State:
        """Return the estimate for images that are resampled to ``size``."""
        factor = 2.0 ** round(math.log2(size[0] / self.disparity.shape[0]))
        disparity = factor * np.asarray(_resized(self.disparity, size=size))
        shifts, error = factor * self.shifts, factor * self.error
        return _State(disparity, self.positions, shifts, error, self.loss)


def register(
    light_field: LightField,
    brightness: ViewBrightness,
    disparity: np.ndarray,
    scale: int,
    config: ViewOrderConfig,
    spacing: float | None = None,
) -> Registration | None:
    """Measure spacing, shifts and camera positions of the views.

    A first measurement is precise enough to recognise a light field that needs no correction; only
    others are measured fully, from coarse to fine.

    Args:
        light_field: At least two views, whose positions are used if it has them.
        brightness: Gains of the views, and which of them are usable.
        disparity: ``[h, w]`` disparity of the centre view, reduced in size by ``scale``, in pixels
            of the light field per view step.
        scale: Pixels of the light field per pixel of ``disparity``.
        config: Settings.
        spacing: Measured spacing of the view columns, which ``disparity`` was measured with; None
            for that of the light field.

    Returns:
        The corrections; None if no view clearly deviates from a regular, rectified grid.
    """
    settings = config.registration
    grid = light_field.grid
    positions = light_field.positions
    regular = view_offsets(*grid, column_spacing=spacing or 1.0) if positions is None else positions
    nominal = regular.reshape(-1, 2).astype(np.float64)
    usable = brightness.usable
    images = np.stack(
        [
            reduce_image(brightness.grey(light_field, v, u), scale)
            for v, u in np.argwhere(usable).tolist()
        ]
    )
    chosen = usable.reshape(-1)
    before_centre = chosen[: np.ravel_multi_index(centre_index(grid), grid)]
    centre = np.array(np.count_nonzero(before_centre), np.int32)
    views = _Views(nominal[chosen], centre, positions is None, scale, settings)

    state = _State(
        (median_filter(disparity) / scale).astype(np.float32),
        nominal[chosen],
        np.zeros((len(images), 2)),
        np.zeros((len(images), 2)),
        np.zeros(len(images)),
    )
    if spacing is None and views.are_regular(images, state):
        return None
    pyramid = [images]
    while len(pyramid) < 3 and min(pyramid[0].shape[1:]) >= 2 * settings.min_size_px:
        pyramid.insert(0, np.stack([reduce_image(image, 2) for image in pyramid[0]]))
    for level in pyramid:
        finest = level is pyramid[-1]
        state = state.at(level.shape[1:])
        state = views.refine(level, state, settings.rounds[1], spacing is not None and finest)
    return views.registration(pyramid[-1], state, usable, spacing)


@dataclass(frozen=True)
class _Views:
    """The usable views: nominal positions ``[n, 2]``, index of the centre view, settings.

    ``free`` is False if the positions were declared: only shifts are measured then. ``scale`` is
    the number of pixels of the light field per pixel of the images at the finest resolution.
    """

    nominal: np.ndarray
    centre: np.ndarray
    free: bool
    scale: int
    settings: RegistrationConfig

    def refine(
        self, images: np.ndarray, state: _State, rounds: int, free_spacing: bool = False
    ) -> _State:
        """Improve shifts, positions and disparity in turn, and the spacing of columns if free."""
        filtered, residual_scale = self._filtered(images)
        for _ in range(rounds):
            state = self._improve_views(filtered, state, residual_scale)
            if not free_spacing:
                state = replace(state, positions=state.positions / self._stretch(state))
            disparity = _improve_disparity(
                filtered, self.centre, state.disparity, *_single(state), residual_scale
            )
            state = replace(state, disparity=median_filter(np.asarray(disparity)))
        return state

    def _filtered(self, images: np.ndarray) -> tuple[np.ndarray, np.floating]:
        """Return high-pass filtered images, and the grey difference of the weight 1/4."""
        filtered = np.asarray(_high_pass(images))
        contrast = float(np.std(filtered[self.centre])) or 1.0
        return filtered, np.float32(self.settings.residual_scale * contrast)

    def _improvement(self, images: np.ndarray, state: _State) -> np.ndarray:
        """Return the fraction by which the corrections lower the loss of each view."""
        filtered, residual_scale = self._filtered(images)
        regular = replace(
            state, positions=self.nominal * self._stretch(state), shifts=np.zeros_like(state.shifts)
        )
        after, before = (
            np.asarray(
                _normal_equations(filtered, self.centre, s.disparity, *_single(s), residual_scale)[
                    -1
                ]
            )
            for s in (state, regular)
        )
        return np.asarray((before - after) / np.maximum(before, 1e-6))

    def are_regular(self, images: np.ndarray, state: _State) -> bool:
        """Return whether no view seems to be displaced.

        The whole images are measured only if the middle half does not show this precisely enough.
        """
        settings, (height, width) = self.settings, images.shape[1:]
        if min(height, width) >= 2 * settings.min_crop_size_px:
            rows, columns = (slice(size // 4, size // 4 + size // 2) for size in (height, width))
            part = replace(state, disparity=state.disparity[rows, columns])
            found = self.refine(images[:, rows, columns], part, settings.rounds[0])
            largest_error = settings.significance * self.scale * float(found.error.max())
            precise = largest_error <= settings.suspicious_shift_px
            centre = images[self.centre]
            precise &= bool(centre[rows, columns].std() >= 0.5 * centre.std())
            if self.free:  # Only a spread of disparity tells a position from a shift.
                precise &= bool(part.disparity.std() >= 0.5 * state.disparity.std())
            if precise and not self._is_displaced(found):
                return True
        return not self._is_displaced(self.refine(images, state, settings.rounds[0]))

    def _is_displaced(self, state: _State) -> bool:
        """Return whether any view seems shifted or not at its place, or fits worse than others."""
        misfit = self._relative_loss(state) > self.settings.max_loss_ratio
        shift, significant, moved = self._deviations(state)
        shifted = (np.abs(shift).max(-1) > self.settings.suspicious_shift_px) & significant
        return bool((shifted | moved | misfit).any())

    def registration(
        self,
        images: np.ndarray,
        state: _State,
        usable: np.ndarray,
        spacing: float | None,
    ) -> Registration | None:
        """Return the corrections that are clear; None if there are none."""
        improvement = self._improvement(images, state)
        clear = improvement > self.settings.min_improvement
        shift, significant, moved = self._deviations(state)
        shifted = (np.abs(shift).max(-1) > self.settings.min_shift_px) & significant & clear
        moved = moved & clear
        ratio = 1.0
        if self.free and spacing is not None:
            ratio = spacing * self._stretch(state)[1]
        if not (shifted.any() or moved.any() or ratio != 1.0):
            return None
        positions = None
        if moved.any() or ratio != 1.0:
            regular = view_offsets(*usable.shape, column_spacing=ratio)
            positions = regular.copy()
            positions[usable] = np.where(moved[:, None], state.positions, regular[usable])
        shifts = None
        if shifted.any() or moved.any():
            shifts = np.zeros((*usable.shape, 2), np.float32)
            # The effect, at the mean disparity, of a position that is not corrected is part of the
            # shift.
            found = np.where(moved[:, None], self.scale * state.shifts, shift)
            large = np.abs(found).max(-1) >= self.settings.min_correction_px
            corrected = large & significant & (improvement > 0)
            shifts[usable] = np.where(corrected[:, None], found, 0.0)
            shifts = shifts if shifts.any() else None
        moved_in_grid = np.zeros(usable.shape, bool)
        moved_in_grid[usable] = moved
        return Registration(float(ratio), positions, shifts, moved_in_grid)

    def _improve_views(
        self, images: np.ndarray, state: _State, residual_scale: np.floating
    ) -> _State:
        """Make one Lucas-Kanade step of the shift and the position of every view."""
        matrices, vectors, variance, loss = map(
            np.asarray,
            _normal_equations(
                images, self.centre, state.disparity, *_single(state), residual_scale
            ),
        )
        matrices = matrices.astype(np.float64)
        trace = np.trace(matrices[:, :2, :2], axis1=1, axis2=2)[:, None] + 1e-12
        diagonal = np.arange(5)
        # The positions are damped most: without a spread of disparity, a change of the position has
        # the same effect as a shift.
        matrices[:, diagonal, diagonal] += trace * np.array([1e-5, 1e-5, 2e-4, 2e-4, 1e-9])
        if not self.free:
            matrices[:, 2:4], matrices[:, :, 2:4] = 0.0, 0.0
            matrices[:, [2, 3], [2, 3]] = 1.0
            vectors = np.where(np.isin(diagonal, (2, 3)), 0.0, vectors)
        step = np.linalg.solve(matrices, vectors[..., None])[..., 0]
        covariance = np.linalg.inv(matrices)[:, [0, 1], [0, 1]] * variance[:, None]
        position_change = np.clip(step[:, 2:4], -1.0, 1.0)
        mean = float(state.disparity.mean())
        shifts = state.shifts + np.clip(step[:, :2], -2.0, 2.0) + mean * position_change
        positions = state.positions + position_change
        shifts[self.centre] = positions[self.centre] = 0.0
        # These changes of all views at once are equivalent to a change of the disparity map.
        factor = _common_factor(self.nominal, positions) if self.free else 1.0
        constant = _common_factor(self.nominal, self.nominal + shifts) - 1.0
        return _State(
            (state.disparity - np.float32(constant)) * np.float32(factor),
            positions / factor,
            shifts - constant * positions,
            np.sqrt(np.maximum(covariance, 0.0)),
            loss,
        )

    def _relative_loss(self, state: _State) -> np.ndarray:
        """Return the loss of each view relative to that of views equally far from the centre view.

        Farther views see more of what is hidden from the centre view.
        """
        distance = np.linalg.norm(self.nominal, axis=-1)
        others = np.arange(len(distance)) != self.centre
        if others.sum() < 5:  # Too few to say what is usual.
            return np.ones(len(distance))
        terms = np.stack([np.ones(len(distance)), distance], axis=-1)
        usual = terms @ np.linalg.lstsq(terms[others], state.loss[others])[0]
        return np.where(others & (usual > 0), state.loss / np.where(usual > 0, usual, 1.0), 1.0)

    def _stretch(self, state: _State) -> np.ndarray:
        """Return ``[2]`` factors of the nominal spacing: 1 of rows, the relative one of columns."""
        stretch = [
            _common_factor(self.nominal[:, [axis]], state.positions[:, [axis]]) for axis in (0, 1)
        ]
        return np.array(stretch) / stretch[0]

    def _deviations(self, state: _State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return how the views deviate from their nominal positions.

        Returns:
            ``[n, 2]`` shift at the mean disparity, in pixels of the light field; ``[n]`` whether
            noise cannot explain the shift; ``[n]`` whether the camera is clearly not at its place.
        """
        change = state.positions - self.nominal * self._stretch(state)
        shift = state.shifts - float(state.disparity.mean()) * change
        significant = np.any(np.abs(shift) > self.settings.significance * state.error, axis=-1)
        effect = self.scale * float(state.disparity.std()) * np.abs(change).max(-1)
        return self.scale * shift, significant, effect > self.settings.min_position_px


def _single(state: _State) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and shifts in single precision."""
    return state.positions.astype(np.float32), state.shifts.astype(np.float32)


def _common_factor(nominal: np.ndarray, positions: np.ndarray) -> float:
    """Return the factor that brings nominal positions closest to others, robust to outliers.

    It minimises the sum of the distances (not squared), by iteratively reweighted least squares.
    """
    weight = np.ones(len(nominal))
    factor = 1.0
    for _ in range(20):
        total = np.sum(weight[:, None] * nominal**2)
        if total == 0.0:
            return 1.0
        factor = float(np.sum(weight[:, None] * nominal * positions) / total)
        distance = np.linalg.norm(positions - factor * nominal, axis=-1)
        weight = 1.0 / np.maximum(distance, 0.02)
    return factor


@kept
def _resized(image: Float[Array, "h w"], *, size: tuple[int, ...]) -> Float[Array, "i j"]:
    """Resample an image to another size, by linear interpolation."""
    return jax.image.resize(image, size, "linear")


@kept
def _high_pass(images: Float[Array, "n h w"]) -> Float[Array, "n h w"]:
    """Subtract the local mean from every image."""
    return jax.lax.map(lambda image: high_pass(image, 4), images)


def _residual(
    image: Float[Array, "h w"],
    centre: Float[Array, "h w"],
    disparity: Float[Array, "h w"],
    position: Float[Array, "2"],
    shift: Float[Array, "2"],
    residual_scale: Float[Array, ""],
) -> tuple[Array, Array, tuple[Array, Array]]:
    """Return the grey difference of a view at each point, its weight, and the image gradient."""
    h, w = centre.shape
    y, x = project_pixels(disparity, position)
    y, x = y + shift[0], x + shift[1]
    inside = (y >= 1) & (y <= h - 2) & (x >= 1) & (x <= w - 2)
    shown = map_coordinates(image, [y, x], order=1, mode="nearest")
    difference = shown - centre
    weight = inside.astype(shown.dtype) / (1 + (difference / residual_scale) ** 2) ** 2
    down, right = jnp.gradient((shown + centre) / 2)
    return difference, weight, (down, right)


@kept
def _normal_equations(
    images: Float[Array, "n h w"],
    centre_number: Int[Array, ""],
    disparity: Float[Array, "h w"],
    positions: Float[Array, "n 2"],
    shifts: Float[Array, "n 2"],
    residual_scale: Float[Array, ""],
) -> tuple[Float[Array, "n 5 5"], Float[Array, "n 5"], Float[Array, " n"], Float[Array, " n"]]:
    """Return normal equations (matrix, vector), residual variance and loss of each view.

    The loss is the mean over the image of a robust function of the grey difference, in [0, 1].
    The unknowns are the shift at the mean disparity, the position, and the gain of the view.
    """
    centre = images[centre_number]
    relative = disparity - disparity.mean()

    def of_view(view: tuple[Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
        difference, weight, (down, right) = _residual(
            view[0], centre, disparity, *view[1:], residual_scale
        )
        jacobian = jnp.stack([down, right, -relative * down, -relative * right, centre])
        weighted = (jacobian * weight[None]).reshape(5, -1)
        matrix = jnp.matmul(weighted, jacobian.reshape(5, -1).T, precision="highest")
        vector = -jnp.matmul(weighted, difference.reshape(-1), precision="highest")
        variance = (weight * difference**2).sum() / (weight.sum() + 1e-6)
        return matrix, vector, variance, 1 - weight.mean()

    return jax.lax.map(of_view, (images, positions, shifts))


@kept
def _improve_disparity(
    images: Float[Array, "n h w"],
    centre_number: Int[Array, ""],
    disparity: Float[Array, "h w"],
    positions: Float[Array, "n 2"],
    shifts: Float[Array, "n 2"],
    residual_scale: Float[Array, ""],
) -> Float[Array, "h w"]:
    """Make one Lucas-Kanade step of the disparity in windows of 5x5 pixels, from all views."""
    centre = images[centre_number]

    def add(sums: tuple[Array, Array], view: tuple[Array, Array, Array]):
        difference, weight, (down, right) = _residual(
            view[0], centre, disparity, *view[1:], residual_scale
        )
        slope = -(view[1][0] * down + view[1][1] * right)
        return (sums[0] + weight * slope**2, sums[1] - weight * slope * difference), None

    zeros = jnp.zeros_like(disparity)
    (matrix, vector), _ = jax.lax.scan(add, (zeros, zeros), (images, positions, shifts))
    matrix, vector = box_mean(matrix, 2), box_mean(vector, 2)
    return disparity + jnp.clip(vector / (matrix + 0.05 * matrix.mean() + 1e-12), -0.5, 0.5)


def _shifted_back(view: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Return a view ``[h, w, c]`` with the displacement ``shift`` of its content undone.

    Lanczos interpolation; the border is repeated outwards.
    """
    margin = int(np.ceil(np.abs(shift).max())) + 4
    moved = np.asarray(_translate(view, shift.astype(np.float32), margin=margin))
    if np.issubdtype(view.dtype, np.integer):
        return np.clip(np.rint(moved), 0, np.iinfo(view.dtype).max).astype(view.dtype)
    return np.clip(moved, min(view.min(), 0.0), max(view.max(), 1.0)).astype(view.dtype)


@kept
def _translate(view: Array, shift: Float[Array, "2"], *, margin: int) -> Float[Array, "h w c"]:
    """Return ``view(y + shift[0], x + shift[1])``."""
    padded = jnp.pad(
        view.astype(jnp.float32), ((margin, margin), (margin, margin), (0, 0)), mode="edge"
    )
    return jax.image.scale_and_translate(
        padded, view.shape, (0, 1), jnp.ones(2, jnp.float32), -shift - margin, "lanczos3"
    )
