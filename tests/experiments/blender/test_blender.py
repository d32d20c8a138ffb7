"""Small renderings by Blender; skipped where Blender is not installed."""

import json
import os
import subprocess
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import occjax
from experiments.blender import RenderConfig, __file__ as package, find_blender, render_scene
from experiments.blender.folder import view_name
from occjax.data.bundled_sample import sample
from occjax.errors import InputError
from occjax.io import read_image, read_pfm
from occjax.ops import warp

CONFIG = RenderConfig(seed=1, style="still_life", image_size=(32, 48), grid=(3, 3), samples=32)

SLANTED_PLANE = """
import sys, numpy as np
from kit.camera import Camera
from kit.geometry import fit_rig
from kit.mesh import pose, sheet
from kit.parts import Part
from kit.scene import SceneDescription, Sky
from kit.stage import build
from kit.surfaces import Surface
grey = Surface("plain", ((0.5, 0.5, 0.5),))
plane = Part(sheet(9.0, 9.0), grey, pose((0, 1, 0), roll=1.1, turn=0.4))
sky = Sky((1, 1, 1), (1, 1, 1), 1.0, 0)
scene = SceneDescription("room", (plane,), (), sky, (0, -1, 0), (0, 1, 0), 50.0, (-1.0, 1.0))
build(scene)
np.savez(sys.argv[1], matrix=plane.matrix, **Camera(scene, (32, 48)).measure())
"""


@pytest.fixture(scope="module")
def blender():
    try:
        python = find_blender()
    except InputError:
        pytest.skip("Blender is not installed")
    return python


@pytest.fixture(scope="module")
def rendered(blender, tmp_path_factory):
    return render_scene(tmp_path_factory.mktemp("render") / "scene", CONFIG, blender=blender)


def test_depth_of_a_slanted_plane_is_that_of_the_ray_through_the_pixel_centre(blender, tmp_path):
    path = tmp_path / "plane.npz"
    subprocess.run(
        [blender, "-c", SLANTED_PLANE, str(path)],
        env={**os.environ, "PYTHONPATH": str(Path(package).parent)},
        stdout=subprocess.DEVNULL,
        check=True,
    )
    measured = np.load(path)
    # The camera stands at (0, -1, 0) and looks along y, so x is right and z is up.
    row, column = np.mgrid[:32, :48] + 0.5
    ray = np.stack(
        [
            (column - 24.0) / 48.0 * 36.0 / 50.0,
            np.ones((32, 48)),
            (16.0 - row) / 48.0 * 36.0 / 50.0,
        ],
        -1,
    )
    normal, point = measured["matrix"][:3, 2], measured["matrix"][:3, 3]
    expected = (point - [0.0, -1.0, 0.0]) @ normal / (ray @ normal)
    np.testing.assert_allclose(measured["depth"], expected, rtol=3e-4)
    assert (measured["objects"] == 1).all()
    assert np.ptp(measured["facing"]) < 1e-3


def test_views_agree_with_the_ground_truth_in_the_documented_layout_only(rendered):
    light_field = occjax.load(rendered, check_orientation=False)
    assert light_field.grid == (3, 3)
    low, high = light_field.disparity_range
    assert low < -0.4 < 0.4 < high

    def disagreement(disparity, rows, columns):
        views = jnp.asarray(light_field.floating())
        centre = views[1, 1]
        errors = [
            jnp.abs(
                warp(
                    views[1 + v, 1 + u],
                    disparity,
                    jnp.array([rows(v, u), columns(v, u)], jnp.float32),
                )
                - centre
            )
            for v, u in ((0, 1), (1, 0), (0, -1), (-1, 0))
        ]
        return float(np.median(np.stack(errors), axis=0).mean())

    truth = jnp.asarray(light_field.ground_truth)
    right = disagreement(truth, lambda v, u: v, lambda v, u: u)
    others = {
        "transposed": disagreement(truth, lambda v, u: u, lambda v, u: v),
        "negative": disagreement(-truth, lambda v, u: v, lambda v, u: u),
        "rows flipped": disagreement(truth, lambda v, u: -v, lambda v, u: u),
        "columns flipped": disagreement(truth, lambda v, u: v, lambda v, u: -u),
        "none": disagreement(0.0 * truth, lambda v, u: v, lambda v, u: u),
    }
    assert right < 0.9 * min(others.values()), (right, others)


def test_rendering_a_view_again_gives_the_same_file(rendered, blender):
    path = rendered / view_name(3)
    before = path.read_bytes()
    path.unlink()
    render_scene(rendered, CONFIG, blender=blender)
    assert path.read_bytes() == before


def test_description_lists_glossy_and_plain_objects(rendered):
    record = json.loads((rendered / "scene.json").read_text())
    numbers = [*record["plain"], *record["glossy"]]
    assert numbers
    assert min(numbers) >= 1


def test_bundled_sample_shows_the_scene_of_its_recipe(blender, tmp_path, tolerance):
    config = RenderConfig(seed=3010, grid=(1, 1), samples=4)
    scene = render_scene(tmp_path / "scene", config, blender=blender)
    bundled = sample()
    truth = read_pfm(scene / "gt_disp_lowres.pfm")
    np.testing.assert_allclose(truth, bundled.ground_truth, **tolerance("float32"))
    difference = read_image(scene / view_name(0)).astype(float) - bundled.centre
    of_blocks = difference.reshape(16, 16, 16, 16, 3).mean((1, 3))
    # Few rays give noise, and a darker image because the tone curve is concave.
    assert np.quantile(np.abs(of_blocks), 0.9) < 8
