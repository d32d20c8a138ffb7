import numpy as np
import pytest

from experiments.blender.kit import mesh, plants, props
from experiments.blender.kit.noise import fractal_noise, value_noise
from experiments.blender.kit.surfaces import Palette

CYLINDER = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 2.0], [0.0, 2.0]])
LINE = np.stack([np.linspace(0.0, 2.0, 9), np.zeros(9), np.zeros(9)], 1)


def volume(shape):
    """Return the signed volume by the divergence theorem; it is negative for inward faces."""
    corner = shape.vertices[shape.faces]
    triangles = np.concatenate([corner[:, [0, 1, 2]], corner[:, [0, 2, 3]]])
    return float(np.linalg.det(triangles).sum() / 6.0)


def regular_polygon(sides):
    """Return the area of a regular polygon with circumradius 1."""
    return sides / 2.0 * np.sin(2.0 * np.pi / sides)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (mesh.box(1.0, 2.0, 3.0), 6.0),
        (mesh.lathe(CYLINDER, 32, smooth=False), 0.5 * regular_polygon(32)),
        (mesh.tube(LINE, 0.3, 12), 2.0 * 0.09 * regular_polygon(12)),
        (mesh.ellipsoid((1.0, 2.0, 3.0), steps=60), np.pi),
    ],
    ids=["box", "lathe", "tube", "ellipsoid"],
)
def test_solids_are_closed_with_outward_faces(shape, expected, tolerance):
    np.testing.assert_allclose(volume(shape), expected, rtol=5e-3)
    # The divergence theorem gives a translation-invariant volume only for closed surfaces.
    elsewhere = mesh.move(shape, (3.0, -2.0, 5.0))
    np.testing.assert_allclose(volume(elsewhere), volume(shape), **tolerance("float64"))


def test_rounded_box_has_the_volume_of_a_box_with_round_edges(tolerance):
    shape = mesh.box(1.0, 2.0, 3.0, 0.2, 12)
    np.testing.assert_allclose(shape.vertices.min(0), [-0.5, -1.0, 0.0], **tolerance("float64"))
    np.testing.assert_allclose(shape.vertices.max(0), [0.5, 1.0, 3.0], **tolerance("float64"))
    # Sum of the inner box, slabs on its faces, quarter cylinders at its edges, and a ball.
    a, b, c, r = 0.6, 1.6, 2.6, 0.2
    faces = 2.0 * r * (a * b + b * c + a * c)
    edges = np.pi * r**2 * (a + b + c)
    expected = a * b * c + faces + edges + 4.0 / 3.0 * np.pi * r**3
    np.testing.assert_allclose(volume(shape), expected, rtol=1e-3)


def test_normals_of_a_ball_point_away_from_its_centre():
    ball = mesh.move(mesh.ellipsoid((2.0, 2.0, 2.0)), (0.0, 0.0, -1.0))
    agreement = (mesh.normals(ball) * ball.vertices).sum(1)
    assert agreement.min() > 0.995


def test_displacement_stays_within_its_height():
    ball = mesh.move(mesh.ellipsoid((2.0, 2.0, 2.0)), (0.0, 0.0, -1.0))
    rough = mesh.displace(ball, np.random.default_rng(0), 0.1, 0.3)
    radius = np.linalg.norm(rough.vertices, axis=1)
    assert radius.std() > 0.02
    assert 0.89 < radius.min() < radius.max() < 1.11


def test_curve_passes_through_its_points(tolerance):
    points = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_allclose(mesh.curve(points, 7)[::7], points, **tolerance("float64"))


def test_pose_rolls_tilts_turns_and_moves_in_this_order(tolerance):
    matrix = mesh.pose((1.0, 2.0, 3.0), turn=np.pi / 2, roll=np.pi / 2, scale=2.0)
    # z rolled about x is -y, and that turned about z is x.
    np.testing.assert_allclose(
        matrix @ [0.0, 0.0, 1.0, 1.0], [3.0, 2.0, 3.0, 1.0], **tolerance("float64")
    )


def test_noise_is_smooth_bounded_and_varied():
    line = np.stack([np.linspace(0.0, 40.0, 8001), np.full(8001, 0.3), np.full(8001, 7.7)], 1)
    noise = value_noise(line, np.random.default_rng(0))
    assert np.abs(noise).max() <= 1.0
    assert noise.std() > 0.2
    # The steepest quintic between -1 and 1 has slope 2 * 15 / 8.
    assert np.abs(np.diff(noise)).max() <= 3.75 * 40.0 / 8000
    many = fractal_noise(line, np.random.default_rng(0), octaves=5)
    assert np.abs(many).max() <= 1.0


@pytest.mark.parametrize(
    "make",
    [*dict.fromkeys(props.SMALL + props.LARGE), plants.potted, plants.branch],
    ids=lambda make: make.__name__,
)
def test_things_have_valid_meshes_and_fit_a_table(make):
    for seed in range(3):
        thing = make(Palette(np.random.default_rng(seed)))
        for part in thing:
            assert np.isfinite(part.mesh.vertices).all()
            assert part.mesh.faces.min() >= 0
            assert part.mesh.faces.max() < len(part.mesh.vertices)
            size = np.ptp(part.mesh.vertices, axis=0).max()
            assert 0.001 < size < 0.8
