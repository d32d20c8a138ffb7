"""Arguments as users have them: integer images, NumPy arrays, numbers, lists, wrong shapes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from occjax.errors import InputError
from occjax.lightfield import LightField

VIEWS = np.random.default_rng(0).uniform(size=(1, 3, 4, 5, 2)).astype(np.float32)
VOLUME = np.random.default_rng(1).uniform(size=(3, 4, 5)).astype(np.float32)
DISPARITY = np.full((4, 5), 0.5, np.float32)
OFFSET = np.array([0.0, -1.0], np.float32)
CANDIDATES = np.array([-1.0, 0.0, 0.5], np.float32)
WEIGHTS = np.full(VIEWS.shape[:4], 0.5, np.float32)

IMAGE_FUNCTIONS = {
    "shift": lambda views: ops.shift(views[0, 0], 0.5, OFFSET),
    "warp": lambda views: ops.warp(views[0, 0], DISPARITY, OFFSET),
    "warp_views": lambda views: ops.warp_views(views, DISPARITY),
    "coarse_volume": lambda views: ops.coarse_volume(views, CANDIDATES),
    "refined_volume": lambda views: ops.refined_volume(views, DISPARITY, CANDIDATES),
    "occlusion_maps": lambda views: ops.occlusion_maps(views, DISPARITY),
    "concatenate": ops.concatenate,
    "mean_and_variance": ops.mean_and_variance,
    "group_correlation": ops.group_correlation(2),
}


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("name", IMAGE_FUNCTIONS)
@pytest.mark.parametrize("dtype", ["uint8", "int32"])
def test_integer_images_are_refused_with_advice(name, dtype):
    """Light fields are stored as uint8, so users try that first."""
    with pytest.raises(InputError, match=rf"floating point, not {dtype}; pass light_field.float"):
        IMAGE_FUNCTIONS[name](jnp.asarray(255 * VIEWS).astype(dtype))


LIGHT_FIELD_FUNCTIONS = {
    "views": lambda light_field: ops.refocus(light_field, 0.5),
    "features": lambda light_field: ops.coarse_volume(light_field, CANDIDATES),
}


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("name", LIGHT_FIELD_FUNCTIONS)
def test_light_fields_are_refused_with_advice(name):
    light_field = LightField(np.zeros((3, 3, 4, 5, 1), np.uint8))
    with pytest.raises(InputError, match=rf"{name} must be .*; pass light_field.floating\(\) or"):
        LIGHT_FIELD_FUNCTIONS[name](light_field)


TRACED_WITH_CONSTANTS = {
    "shift": (lambda d: ops.shift(VIEWS[0, 0], d, OFFSET), np.float32(0.5)),
    "warp": (lambda d: ops.warp(VIEWS[0, 0], d, OFFSET), DISPARITY),
    "coarse_volume": (lambda c: ops.coarse_volume(VIEWS, c, weights=WEIGHTS), CANDIDATES),
    "refined_volume": (lambda d: ops.refined_volume(VIEWS, d, CANDIDATES), DISPARITY),
    "occlusion_maps": (lambda d: ops.occlusion_maps(VIEWS, d), DISPARITY),
    "winner_takes_all": (lambda c: ops.winner_takes_all(VOLUME, c), CANDIDATES),
    "soft_argmin": (lambda c: ops.soft_argmin(VOLUME, c), CANDIDATES),
    "aperture_weights": (lambda d: ops.aperture_weights(ops.view_offsets(1, 3), d), 2.0),
    "rows": (lambda d: ops.shift(VIEWS[0, 0], d, OFFSET, rows=(jnp.int32(-1), 6)), np.float32(0.5)),
}


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("name", TRACED_WITH_CONSTANTS)
def test_numpy_arrays_are_constants_of_compiled_functions(name, tolerance):
    function, traced = TRACED_WITH_CONSTANTS[name]
    np.testing.assert_allclose(jax.jit(function)(traced), function(traced), **tolerance("float32"))


NUMBERS_AND_LISTS = {
    "shift": lambda take: ops.shift(VIEWS[0, 0], take(0.5), take([0.0, -1.0])),
    "coarse_volume": lambda take: ops.coarse_volume(VIEWS, take([-1.0, 0.0, 0.5])),
    "refined_volume": lambda take: ops.refined_volume(VIEWS, DISPARITY, take([-1.0, 0.0])),
    "soft_argmin": lambda take: ops.soft_argmin(VOLUME, take([-1.0, 0.0, 0.5])),
    "confidence": lambda take: ops.confidence(VOLUME / VOLUME.sum(0), take([-1.0, 0.0, 0.5])),
}


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("name", NUMBERS_AND_LISTS)
def test_numbers_and_lists_are_accepted(name):
    function = NUMBERS_AND_LISTS[name]
    plain, arrays = function(lambda value: value), function(lambda value: jnp.float32(value))
    np.testing.assert_array_equal(plain, arrays)


MISFITS = {
    r"features must be \[v, u, h, w, c\], .*; pass grey images as features\[..., None\]": (
        lambda: ops.coarse_volume(VIEWS[..., 0], CANDIDATES)
    ),
    r"features must be \[v, u, h, w, c\], not \[1, 1, 3": (
        lambda: ops.refined_volume(VIEWS[None], DISPARITY, CANDIDATES)
    ),
    r"candidates must be a vector \[d\], d at least 1, not \[\]": lambda: ops.coarse_volume(
        VIEWS, 0.5
    ),
    r"candidates must be \[3\] or \[3, 4, 5\] like the costs, not \[1\]": (
        lambda: ops.soft_argmin(VOLUME, CANDIDATES[:1])
    ),
    r"like the probabilities, not \[3, 1, 1\]": (
        lambda: ops.expected_disparity(VOLUME, CANDIDATES[:, None, None])
    ),
    r"probabilities must be \[d, h, w\], not \[3, 4, 5, 1\]": (
        lambda: ops.confidence(VOLUME[..., None], CANDIDATES)
    ),
    r"d at least 3, not \[3, 4, 5\] and \[2\]": (
        lambda: ops.winner_takes_all(VOLUME, CANDIDATES[:2])
    ),
    r"weights must be \[1, 3, 4, 5\], not \[1, 3, 1, 1\]": (
        lambda: ops.coarse_volume(VIEWS, CANDIDATES, weights=WEIGHTS[:, :, :1, :1])
    ),
    r"weights must be \[1, 3, 2, 5\], not \[1, 3, 4, 5\]": (
        lambda: ops.refined_volume(VIEWS, DISPARITY[:2], CANDIDATES, weights=WEIGHTS)
    ),
    r"weights must be \[1, 3, 4, 5\], not \[3, 4, 5\]": (
        lambda: ops.mean_and_variance(VIEWS, WEIGHTS[0])
    ),
    r"offsets must be \[1, 3, 2\], not \[3, 2\]": (
        lambda: ops.warp_views(VIEWS, DISPARITY, offsets=np.zeros((3, 2)))
    ),
    r"candidates must be a vector \[d\], d at least 1, not \[0\]": (
        lambda: ops.coarse_volume(VIEWS, np.zeros(0))
    ),
    r"offset must be \[2\], not \[\]": lambda: ops.shift(VIEWS[0, 0], 1.0, 3),
    r"offset must be \[2\], not \[3\]": (lambda: ops.warp(VIEWS[0, 0], DISPARITY, np.arange(3.0))),
    r"offset must be \[2\], not \[3, 3, 2\]": (
        lambda: ops.cross_view_difference(DISPARITY, DISPARITY, np.ones((3, 3, 2)))
    ),
    r"rows must be \(first row, number of rows\), not 5": (
        lambda: ops.coarse_volume(VIEWS, CANDIDATES, rows=5)
    ),
    r"rows are 6 from row 0, but the image has 4 rows": (
        lambda: ops.coarse_volume(VIEWS, CANDIDATES, rows=(0, 6), streamed=True)
    ),
    r"rows are 5 from row -2, but": lambda: ops.shift(VIEWS[0, 0], 1.0, OFFSET, rows=(-2, 5)),
    r"combine must be a function such as ops.concatenate, not 'concatenate'": (
        lambda: ops.coarse_volume(VIEWS, CANDIDATES, combine="concatenate")
    ),
    r"offsets must be \[v, u, 2\], not \[3, 2\]": (
        lambda: ops.aperture_weights(np.ones((3, 2)), 1.0)
    ),
    r"usable must be \[1, 1\], not \[1, 3\]": lambda: ops.cross_view_counts(
        DISPARITY[None, None], tolerance=0.1, usable=np.ones((1, 3), bool)
    ),
    r"tolerance must be at least 0, not -1": (
        lambda: ops.cross_view_counts(DISPARITY[None, None], tolerance=-1)
    ),
    r"diameter must be at least 0, not -1": lambda: ops.aperture_weights(np.ones((1, 3, 2)), -1),
    r"\(v, u\) is \(0, 3\); it must be two whole numbers": lambda: ops.view_offsets(0, 3),
    r"\(v, u\) is \(2.5, 3\); it must be two whole numbers": lambda: ops.view_offsets(2.5, 3),
    r"points must be \[h, w, 3\], not \[4, 5\]": lambda: ops.surface_normals(DISPARITY),
    r"depth must be \[h, w\], not \[1, 4, 5\]": lambda: ops.back_project(DISPARITY[None], None),
    r"calibration must be a Calibration, not None": lambda: ops.back_project(DISPARITY, None),
    r"a Calibration, not None; a light field": lambda: ops.depth_from_disparity(DISPARITY, None),
    r"disparity must be one number, not \[2\]": (
        lambda: ops.shift(VIEWS[0, 0], CANDIDATES[:2], OFFSET)
    ),
    r"disparity must be \[4, 5\] like the image, or some of its rows, not \[4, 4\]": (
        lambda: ops.refined_volume(VIEWS, DISPARITY[:, :4], CANDIDATES)
    ),
    r"disparity must be \[4, 5\] like the image, or some of its rows, not \[8, 5\]": (
        lambda: ops.warp_views(VIEWS, np.tile(DISPARITY, (2, 1)))
    ),
    r"disparity must be \[4, 5\] like the views, not \[1, 5\]": (
        lambda: ops.occlusion_maps(VIEWS, DISPARITY[:1])
    ),
}


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("message", MISFITS)
def test_shapes_that_do_not_fit_are_refused_not_broadcast(message):
    with pytest.raises(InputError, match=message):
        MISFITS[message]()
