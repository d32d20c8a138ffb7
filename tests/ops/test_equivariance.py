"""Light field geometry: a slanted plane in closed form, symmetries and shears."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from tests.ops.arrays import random
from tests.reference import ops as reference


class TestSlantedPlane:
    """A plane of known slanted disparity; its texture and all its views in closed form."""

    size = (9, 11)
    plane = (0.4, 0.05, -0.07)

    @staticmethod
    def inside(disparity, grid, size):
        """Mask ``[v, u, h, w]`` of the centre view's points that lie inside each view."""
        offsets = reference.view_offsets(*grid)[:, :, None, None]
        y, x = np.meshgrid(np.arange(size[0]), np.arange(size[1]), indexing="ij")
        row, column = y - disparity * offsets[..., 0], x - disparity * offsets[..., 1]
        return (row >= 0) & (row <= size[0] - 1) & (column >= 0) & (column <= size[1] - 1)

    @pytest.mark.parametrize("grid", [(3, 3), (1, 5), (4, 2)])
    def test_true_disparity_registers_an_affine_texture_exactly(self, grid, tolerance):
        """Bilinear interpolation of an affine image is exact."""
        views, disparity = reference.slanted_plane(
            grid, self.size, self.plane, lambda y, x: 0.2 + 0.03 * y - 0.05 * x
        )
        inside = self.inside(disparity, grid, self.size)
        assert inside.mean() > 0.8
        views, disparity = np.float32(views), np.float32(disparity)
        warped = np.asarray(jax.jit(ops.warp_views)(views, disparity))
        centre = np.broadcast_to(views[grid[0] // 2, grid[1] // 2], views.shape)
        np.testing.assert_allclose(warped[inside], centre[inside], **tolerance("float32"))
        maps = np.asarray(jax.jit(ops.occlusion_maps)(views, disparity))
        np.testing.assert_allclose(maps[inside], 0.0, **tolerance("float32"))

    def test_true_disparity_registers_a_curved_texture_within_the_interpolation_error(self):
        views, disparity = reference.slanted_plane(
            (3, 3), self.size, self.plane, lambda y, x: np.sin(0.7 * y + 0.3) + np.cos(0.5 * x)
        )
        inside = self.inside(disparity, (3, 3), self.size)
        warped = np.asarray(jax.jit(ops.warp_views)(np.float32(views), np.float32(disparity)))
        # |f_yy| / 8 + |f_xx| / 8; seen obliquely the texture is up to 1 / 0.88 times finer
        bound = (0.7**2 + 0.5**2) / 8 / 0.88**2
        assert np.abs(warped - views[1, 1])[inside].max() < bound
        wrong = np.asarray(jax.jit(ops.warp_views)(np.float32(views), np.float32(-disparity)))
        assert np.abs(wrong - views[1, 1])[inside].max() > 5 * bound

    def test_variance_of_a_ramp_grows_with_the_square_of_the_error_in_disparity(self, tolerance):
        """A disparity error e changes the value of view (dv, du) by ``e * (a dv + b du)``.

        Over a 3x3 grid the mean of dv^2 and of du^2 is 2/3, that of dv * du is zero.
        """
        slope_y, slope_x = 0.3, -0.2
        views, _ = reference.slanted_plane(
            (3, 3), self.size, (0.5, 0.0, 0.0), lambda y, x: slope_y * y + slope_x * x
        )
        candidates = np.array([0.0, 0.5, 0.75, 1.5], np.float32)
        volume = jax.jit(ops.coarse_volume, static_argnames="combine")(
            np.float32(views), candidates, combine=ops.mean_and_variance
        )
        variance = (candidates - 0.5) ** 2 * (slope_y**2 + slope_x**2) * 2 / 3
        expected = np.broadcast_to(variance[:, None, None], (4, 5, 7))
        interior = volume[:, 2:-2, 2:-2, 1]
        np.testing.assert_allclose(interior, expected, **tolerance("float32"))

    def test_operations_together_recover_the_disparity_of_the_plane(self):
        """Variance as cost, a coarse and a refined stage: the cascade without learning."""
        size = (20, 22)
        views, truth = reference.slanted_plane(
            (5, 5), size, (-0.3, 0.03, 0.02), lambda y, x: np.sin(0.9 * y + 0.4 * x) + np.cos(x)
        )

        @jax.jit
        def estimate(views, weights):
            candidates = jnp.linspace(-1.0, 1.0, 9)
            coarse_costs = ops.coarse_volume(views, candidates, combine=ops.mean_and_variance)
            coarse = ops.soft_argmin(100.0 * coarse_costs[..., 1], candidates)
            residuals = jnp.linspace(-0.25, 0.25, 9)
            refined_costs = ops.refined_volume(
                views, coarse, residuals, combine=ops.mean_and_variance
            )
            return coarse, coarse + ops.soft_argmin(weights * refined_costs[..., 1], residuals)

        coarse, refined = (np.asarray(m) for m in estimate(np.float32(views), np.float32(1000.0)))
        interior = (slice(3, -3), slice(3, -3))
        assert np.abs(coarse - truth)[interior].mean() < 0.1
        assert np.abs(refined - truth)[interior].mean() < 0.03


def flip_rows(array, grid_axes, pixel_axes):
    return np.flip(array, (*grid_axes[:1], *pixel_axes[:1]))


def flip_columns(array, grid_axes, pixel_axes):
    return np.flip(array, (*grid_axes[1:], *pixel_axes[1:]))


def transpose(array, grid_axes, pixel_axes):
    for axes in (grid_axes, pixel_axes):
        if axes:
            array = np.swapaxes(array, *axes)
    return array


def rotate(array, grid_axes, pixel_axes):
    for axes in (grid_axes, pixel_axes):
        if axes:
            array = np.rot90(array, axes=axes)
    return array


CANDIDATES = jnp.array([-1.3, 0.0, 0.45])


def unfolded(volume, views):
    """A concatenated volume ``[d, h, w, v * u * c]`` as ``[v, u, h, w, c, d]``."""
    v, u, h, w, c = views.shape
    return volume.reshape(-1, h, w, v, u, c).transpose(3, 4, 1, 2, 5, 0)


def coarse(views, disparity):
    return unfolded(ops.coarse_volume(views, CANDIDATES), views)


def refined(views, disparity):
    return unfolded(ops.refined_volume(views, disparity, CANDIDATES), views)


def weights(views, disparity):
    return ops.occlusion_weights(ops.occlusion_maps(views, disparity, border="zero"))


OPERATIONS = {
    function.__name__: jax.jit(function) for function in (ops.warp_views, coarse, refined, weights)
}
"""All return ``[v, u, h, w, ...]``."""


@pytest.mark.parametrize("operation", OPERATIONS)
@pytest.mark.parametrize("symmetry", [flip_rows, flip_columns, transpose, rotate])
def test_views_and_images_transformed_together_transform_the_result(operation, symmetry, tolerance):
    views = random(3, 3, 4, 5, 2, low=0.0)
    disparity = random(4, 5, seed=1, low=-2.0, high=2.0)
    function = OPERATIONS[operation]
    expected = symmetry(np.asarray(function(views, disparity)), (0, 1), (2, 3))
    moved = symmetry(views, (0, 1), (2, 3)), symmetry(disparity, (), (0, 1))
    actual = function(*(np.ascontiguousarray(each) for each in moved))
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


@pytest.mark.parametrize("shear", [1, -2])
def test_shearing_the_views_adds_to_the_disparity(shear, tolerance):
    """View (v, u) moved by -s (v - v0), -s (u - u0): every point has s more disparity."""
    views = random(3, 3, 10, 11, 1, low=0.0)
    disparity = random(10, 11, seed=1, low=-1.0, high=1.0)
    sheared = views.copy()
    for v, u in np.ndindex(3, 3):
        sheared[v, u] = np.roll(views[v, u], (-shear * (v - 1), -shear * (u - 1)), (0, 1))
    interior = np.s_[:, :, 4:-4, 4:-4]  # without the pixels that were rolled around
    warp_views = OPERATIONS["warp_views"]
    expected = warp_views(views, disparity)[interior]
    actual = warp_views(sheared, disparity + np.float32(shear))[interior]
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))
    volume = jax.jit(ops.coarse_volume)
    expected = volume(views, CANDIDATES)[interior[1:]]
    actual = volume(sheared, CANDIDATES + float(shear))[interior[1:]]
    np.testing.assert_allclose(actual, expected, **tolerance("float32"))


@pytest.mark.parametrize("operation", OPERATIONS)
def test_vmap_is_a_loop_over_light_fields(operation, tolerance):
    views = random(2, 3, 3, 4, 5, 2, low=0.0)
    disparities = random(2, 4, 5, seed=1, low=-2.0, high=2.0)
    function = OPERATIONS[operation]
    expected = [function(*each) for each in zip(views, disparities, strict=True)]
    batch = jax.vmap(function)(views, disparities)
    np.testing.assert_allclose(batch, np.stack(expected), **tolerance("float32"))
