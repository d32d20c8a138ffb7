"""Random light fields against independent geometry in NumPy and against their configuration."""

import dataclasses

import jax
import numpy as np
import pytest
from scipy.ndimage import map_coordinates, maximum_filter, minimum_filter

from occjax.data.procedural import (
    Defects,
    Outlines,
    SceneConfig,
    Solids,
    generate,
    true_disparities,
)
from occjax.data.procedural.scenes import ABSENT_DISPARITY, random_scene
from occjax.errors import InputError
from tests.reference.surfaces import first_hit

FAULTLESS = Defects(noise=0.0, vignetting=0.0, blur=0.0, gamma=0.0, quantisation=0.0)
SMALL = SceneConfig(
    image_size=(40, 48),
    grid=(3, 3),
    views="all",
    rays=9,
    sheets=3,
    solids=3,
    disparity_range=(-2.0, 3.0),
    disparity_width=(0.5, 5.0),
    highlights=0.0,
    reflections=0.0,
    defects=FAULTLESS,
)
OFF = dataclasses.replace(
    SMALL,
    sheets=2,
    solids=2,
    solid_kinds=Solids(0.0, 0.0, 0.0, 0.0),
    outlines=Outlines(*[0.0] * 7),
    slanted=0.0,
    curved=0.0,
    textureless=1.0,
    shading=0.0,
    shadows=0.0,
    creases=0.0,
)
SWITCHED_OFF = ("solid_kinds", "outlines", "slanted", "curved", "textureless", "low_contrast")
SWITCHED_OFF += ("shading", "shadows", "creases", "highlights", "reflections")
ON = dataclasses.replace(OFF, **{name: getattr(SceneConfig(), name) for name in SWITCHED_OFF})
KEYS = jax.random.split(jax.random.key(7), 5)


@pytest.fixture(scope="module")
def samples():
    """A few small light fields of cameras without defects."""
    return [jax.tree.map(np.asarray, generate(key, SMALL)) for key in KEYS]


def test_shapes_and_ranges(samples):
    for sample in samples:
        assert sample.views.shape == sample.visibility.shape == (3, 3, 40, 48)
        assert sample.disparity.shape == sample.valid.shape == (40, 48)
        assert 0.0 <= sample.views.min() <= sample.views.max() <= 1.0
        assert -2.0 <= sample.disparity.min() <= sample.disparity.max() <= 3.0
        assert sample.valid.all()
        assert sample.visibility[1, 1].all()


def test_the_same_key_gives_the_same_light_field_and_another_key_another(samples):
    again = generate(KEYS[0], SMALL)
    jax.tree.map(np.testing.assert_array_equal, again, samples[0])
    assert np.abs(samples[0].views - samples[1].views).mean() > 0.01


@pytest.mark.slow
def test_vmap_is_a_loop(samples):
    batch = jax.vmap(lambda key: generate(key, SMALL))(KEYS)
    stacked = jax.tree.map(lambda *parts: np.stack(parts), *samples)
    # Another order of rounding may send a ray past an edge that it has hit.
    for one, other in zip(batch, stacked, strict=True):
        one, other = np.asarray(one, np.float64), np.asarray(other, np.float64)
        assert (np.abs(one - other) > 1e-3).mean() < 2e-3


def test_disparity_and_visibility_are_those_of_rays_traced_one_by_one(samples, tolerance):
    random = np.random.default_rng(0)
    drawn = jax.jit(lambda key: random_scene(jax.random.split(key, 3)[0], SMALL).geometry)
    hidden = 0
    for key, sample in zip(KEYS, samples, strict=True):
        scene = jax.tree.map(np.asarray, drawn(key))
        for _ in range(60):
            row, column = random.integers(40), random.integers(48)
            y, x = row - 19.5, column - 23.5
            d, _, clear = first_hit(scene, y, x, (0.0, 0.0))
            if not clear:
                continue
            np.testing.assert_allclose(sample.disparity[row, column], d, **tolerance("float32"))
            for v, u in [(0, 0), (0, 1), (2, 0), (1, 2)]:
                t, s = v - 1.0, u - 1.0
                inside = 0 <= row - d * t <= 39 and 0 <= column - d * s <= 47
                nearest, _, clear = first_hit(scene, y - d * t, x - d * s, (t, s))
                if clear and not 1e-4 < nearest - d < 1e-2:
                    visible = inside and nearest < d + 2e-3
                    hidden += inside and not visible
                    assert sample.visibility[v, u, row, column] == visible
    assert hidden > 10


def test_true_disparity_of_every_view_is_that_of_rays_traced_one_by_one(samples, tolerance):
    random = np.random.default_rng(0)
    maps = np.asarray(true_disparities(KEYS[0], SMALL))
    np.testing.assert_allclose(maps[1, 1], samples[0].disparity, **tolerance("absolute"))
    geometry = jax.jit(lambda key: random_scene(jax.random.split(key, 3)[0], SMALL).geometry)
    scene = jax.tree.map(np.asarray, geometry(KEYS[0]))
    for _ in range(60):
        v, u, row, column = (random.integers(size) for size in maps.shape)
        d, _, clear = first_hit(scene, row - 19.5, column - 23.5, (v - 1.0, u - 1.0))
        if clear:
            np.testing.assert_allclose(maps[v, u, row, column], d, **tolerance("float32"))


def test_visible_pixels_agree_when_warped_by_the_ground_truth(samples):
    rows, columns = np.mgrid[:40, :48].astype(np.float64)
    errors = {True: [], False: []}
    for sample in samples:
        d = sample.disparity
        smooth = maximum_filter(d, 5) - minimum_filter(d, 5) < 0.3
        for v, u in [(0, 0), (0, 2), (2, 1), (1, 0)]:
            t, s = sample.offsets[v, u]
            where = (rows - d * t, columns - d * s)
            warped = map_coordinates(sample.views[v, u], where, order=1, mode="nearest")
            error = np.abs(warped - sample.views[1, 1])
            visible = sample.visibility[v, u]
            errors[True].append(error[visible & smooth])
            errors[False].append(error[~visible])
    visible, hidden = (np.concatenate(errors[key]) for key in (True, False))
    assert np.median(visible) < 0.01
    assert visible.mean() < 0.02
    assert hidden.mean() > 4.0 * visible.mean()


@pytest.mark.slow
def test_ingredients_are_there_and_each_can_be_switched_off():
    keys = jax.random.split(jax.random.key(1), 24)
    on, off = (_ingredients(config, keys) for config in (ON, OFF))
    assert on == dict.fromkeys(on, True)
    assert off == dict.fromkeys(off, False)


def _ingredients(config, keys):
    """Return which ingredients are present in any of some scenes."""

    def one(key):
        scene = random_scene(key, config)
        return scene.geometry, scene.materials, scene.light

    geometry, materials, light = jax.tree.map(np.asarray, jax.jit(jax.vmap(one))(keys))
    walls = geometry.walls
    present = walls.translation[:, :, 2] != -ABSENT_DISPARITY
    there = {
        "solids": geometry.solids.half_extent > 0.0,
        "outlines": geometry.outlines,
        "slanted": (walls.matrix[:, :, 2, :2] != 0.0).any(axis=-1) & present,
        "curved walls": walls.quadratic != 0.0,
        "curved sheets": geometry.sheets.quadratic != 0.0,
        "texture": materials.contrast > 0.0,
        "detail": materials.detail_contrast > 0.0,
        "highlights": materials.gloss > 0.0,
        "reflections": materials.mirror > 0.0,
        "shading": light.strength > 0.0,
        "shadows": light.shadow > 0.0,
        "creases": light.crease > 0.0,
    }
    return {name: bool(values.any()) for name, values in there.items()}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"disparity_range": (2.0, 1.0)}, "disparity_range"),
        ({"disparity_width": (1.0, 9.0)}, "disparity_width"),
        ({"image_size": (0, 8)}, "image_size"),
        ({"grid": (8, 8)}, "grid"),
        ({"grid": (9, 7)}, "grid"),
        ({"rays": 5}, "rays"),
        ({"walls": 0}, "walls"),
    ],
)
def test_a_distribution_that_cannot_be_drawn_is_refused(wrong, message):
    with pytest.raises(InputError, match=message):
        SceneConfig(**wrong)
