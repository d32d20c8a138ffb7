import numpy as np
import pytest

from experiments.blender.kit.parts import corners, footprint, scatter
from experiments.blender.kit.props import cup, vase
from experiments.blender.kit.scene import STYLES, make_scene
from experiments.blender.kit.surfaces import Palette


@pytest.mark.slow
@pytest.mark.parametrize("style", STYLES)
def test_scene_is_determined_by_its_seed(style):
    first, again, other = (make_scene(seed, style) for seed in (5, 5, 6))
    assert len(first.parts) == len(again.parts)
    for one, two in zip(first.parts, again.parts, strict=True):
        np.testing.assert_array_equal(one.mesh.vertices, two.mesh.vertices)
        np.testing.assert_array_equal(one.matrix, two.matrix)
        assert one.surface == two.surface
    assert (first.lights, first.sky, first.eye) == (again.lights, again.sky, again.eye)
    assert first.eye != other.eye


@pytest.mark.slow
def test_mixed_style_alternates_by_seed():
    assert [make_scene(10 + k).style for k in range(len(STYLES))] == list(STYLES)


@pytest.mark.parametrize("style", STYLES)
def test_camera_is_outside_all_objects_and_sees_some(style):
    scene = make_scene(2, style)
    points = corners(scene.parts) - scene.eye
    forward = np.subtract(scene.target, scene.eye)
    forward /= np.linalg.norm(forward)
    depth = points @ forward
    aside = np.linalg.norm(points - depth[:, None] * forward, axis=1)
    # Half of the image's width at unit distance.
    field = 18.0 / scene.lens_mm
    seen = (depth > 0.0) & (aside < field * depth)
    assert seen.sum() > 1000
    assert depth[seen].min() > 0.1


@pytest.mark.slow
def test_most_disparity_ranges_are_within_2_and_all_within_3_5():
    ranges = np.array([make_scene(seed, "wires").disparity_range for seed in range(40)])
    assert (ranges[:, 0] < -0.4).all()
    assert (ranges[:, 1] > 0.4).all()
    assert np.abs(ranges).max() <= 3.5
    within_two = (np.abs(ranges) <= 2.0).all(1)
    assert 0.6 < within_two.mean() < 1.0


def test_scattered_things_do_not_overlap_and_stand_on_the_table(tolerance):
    palette = Palette(np.random.default_rng(0))
    things = [vase(palette) for _ in range(6)] + [cup(palette) for _ in range(6)]
    taken = []
    placed = scatter(palette.rng, things, (-0.3, 0.3, -0.3, 0.3), height=0.7, taken=taken)
    assert len(taken) > 6
    assert sorted(radius for *_, radius in taken) <= sorted(map(footprint, things))
    for k, (x, y, radius) in enumerate(taken):
        for a, b, other in taken[:k]:
            assert np.hypot(x - a, y - b) > radius + other
    np.testing.assert_allclose(corners(placed)[:, 2].min(), 0.7, **tolerance("float64"))
