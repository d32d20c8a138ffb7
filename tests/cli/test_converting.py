"""``occjax convert``: files, printed text and refused arguments."""

import functools

import imageio.v3 as imageio
import numpy as np
import pytest
from PIL import Image

from occjax.estimators import Estimate
from occjax.io import read_pfm, write_pfm
from occjax.lightfield import Calibration, LightField
from occjax.results.outputs import output_options, write_outputs
from tests.io.files import CONFIG
from tests.io.test_ply import read_vertices

HEIGHT, WIDTH = 20, 24
DISPARITY = np.random.default_rng(0).uniform(-0.2, 0.3, (HEIGHT, WIDTH)).astype(np.float32)
VIEWS = np.random.default_rng(1).integers(0, 256, (3, 3, HEIGHT, WIDTH, 3), np.uint8)


def depth_of(disparity):
    """``beta f_d / (d f_d sensor + beta)`` with the numbers of ``CONFIG``, in metres."""
    beta = 50.0 * 100.0 * WIDTH
    return beta * 7200.0 / (disparity.astype(np.float64) * 7200.0 * 35.0 + beta) / 1000.0


@pytest.fixture
def run(occjax_command, monkeypatch, tmp_path):
    """Run ``occjax convert ARGUMENTS`` in a folder with maps; returns code, output and errors."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    np.save("disparity.npy", DISPARITY)
    write_pfm("disparity.pfm", DISPARITY)
    return functools.partial(occjax_command, "convert")


@pytest.fixture
def scene(tmp_path):
    """A folder in the layout of the HCI benchmark, of the size of the map."""
    folder = tmp_path / "scene"
    folder.mkdir()
    for number, view in enumerate(VIEWS.reshape(9, HEIGHT, WIDTH, 3)):
        imageio.imwrite(folder / f"input_Cam{number:03d}.png", view)
    (folder / "parameters.cfg").write_text(CONFIG)
    return folder


def test_a_map_is_converted_through_every_format(run):
    for source, target in (
        ("disparity.pfm", "a.npy"),
        ("a.npy", "b.png"),
        ("b.png", "c.pfm"),
        ("c.pfm", "d.png"),
    ):
        code, out, err = run(source, target)
        assert (code, err) == (0, "")
        assert f"{target}: 20x24 pixels (rows x columns) of disparity, " in out
    np.testing.assert_array_equal(np.load("a.npy"), DISPARITY)
    step = np.ptp(DISPARITY) / 65533
    np.testing.assert_allclose(read_pfm("c.pfm"), DISPARITY, rtol=0, atol=0.51 * step)
    assert f"kept to within {0.5 * step:.2g}" in out


def test_depth_and_back_with_the_camera_of_a_scene_and_of_a_file(run, scene, tolerance):
    code, out, _ = run("disparity.pfm", "depth.npy", "--to", "depth", "--scene", scene)
    assert code == 0
    assert f"camera: {scene}/parameters.cfg" in out
    assert f"{depth_of(DISPARITY).min():.4g} to {depth_of(DISPARITY).max():.4g} metres" in out
    np.testing.assert_allclose(np.load("depth.npy"), depth_of(DISPARITY), **tolerance("relative"))
    options = ("--to", "disparity", "--parameters", scene / "parameters.cfg")
    assert run("depth.npy", "again.pfm", *options)[0] == 0
    np.testing.assert_allclose(read_pfm("again.pfm"), DISPARITY, **tolerance("absolute"))


def test_the_camera_next_to_the_map_is_found(run, scene, tolerance):
    write_pfm(scene / "gt_disp_lowres.pfm", DISPARITY)
    assert run(scene / "gt_disp_lowres.pfm", "depth.pfm", "--to", "depth")[0] == 0
    np.testing.assert_allclose(read_pfm("depth.pfm"), depth_of(DISPARITY), **tolerance("relative"))


def test_camera_options_override_and_complete_the_camera(run, scene, tolerance):
    depth = ("disparity.pfm", "depth.npy", "--to", "depth")
    whole = ("--focal-length-mm", 100, "--sensor-mm", 35, "--baseline-mm", 50, "--focus-m", 7.2)
    assert run(*depth, *whole)[0] == 0
    np.testing.assert_allclose(np.load("depth.npy"), depth_of(DISPARITY), **tolerance("relative"))
    # Twice the baseline: every disparity is that of half of it.
    assert run(*depth, "--scene", scene, "--baseline-mm", 100, "--overwrite")[0] == 0
    np.testing.assert_allclose(
        np.load("depth.npy"), depth_of(DISPARITY / 2), **tolerance("relative")
    )
    code, _, err = run(*depth, *whole[:4], "--overwrite")
    assert code == 2
    assert "pass --baseline-mm and --focus-m too (inf for parallel cameras)" in err
    code, _, err = run(*depth, *whole[:6], "--focus-m", -1, "--overwrite")
    assert code == 2
    assert "--focus-m is -1; it must be a positive number" in err


def test_points_have_the_position_and_colour_of_their_pixels(run, scene, tolerance):
    code, out, err = run("disparity.pfm", "cloud.ply", "--scene", scene)
    assert (code, err) == (0, "")
    assert "480 points in the colours of the centre view; metres" in out
    vertices, _ = read_vertices(scene.parent / "here/cloud.ply")
    colours = np.stack([vertices[name] for name in ("red", "green", "blue")], -1)
    np.testing.assert_array_equal(colours, VIEWS[1, 1].reshape(-1, 3))
    np.testing.assert_allclose(-vertices["z"], depth_of(DISPARITY).ravel(), **tolerance("relative"))
    column = (WIDTH - 1) / 2 + 100.0 / 35.0 * WIDTH * vertices["x"] / -vertices["z"]
    np.testing.assert_allclose(column, np.tile(np.arange(WIDTH), HEIGHT), **tolerance("float32"))


@pytest.mark.parametrize("min_confidence", [None, 0.5])
@pytest.mark.parametrize("camera", [None, Calibration(100.0, 35.0, 50.0, 7.2)])
def test_points_of_a_folder_of_results_are_those_of_the_estimate(
    run, tmp_path, min_confidence, camera
):
    """A black corner, and two rows of confidence 0 and 0.25, which have points or not."""
    views, confidence = VIEWS.copy(), np.ones_like(DISPARITY)
    views[:, :, :3, :3] = 0
    confidence[5], confidence[6] = 0.0, 0.25
    disparity = np.full_like(DISPARITY, 0.25)  # no pixel is between two surfaces
    estimate = Estimate(disparity, confidence, confidence, (-0.5, 0.5), "photometric")
    write_outputs(
        estimate,
        LightField(views, calibration=camera),
        tmp_path / "results",
        output_options("maps,cloud", min_confidence),
        settings={"options": {"min_confidence": min_confidence}},
    )
    code, out, err = run(tmp_path / "results", "cloud.ply")
    assert (code, err) == (0, "")
    written = (tmp_path / "here/cloud.ply").read_bytes()
    assert written == (tmp_path / "results/points.ply").read_bytes()
    left_out = 9 + WIDTH + (0 if min_confidence is None else WIDTH)
    assert f"{DISPARITY.size - left_out} points in the colours of the centre view" in out
    assert f"{left_out} pixels without a point in space or left out by the estimate" in out


def test_without_a_camera_points_are_a_relief(run, tmp_path):
    code, out, _ = run("disparity.npy", "relief.ply")
    assert code == 0
    assert "depth has no true scale" in out
    assert read_vertices(tmp_path / "here/relief.ply")[0].dtype.names == ("x", "y", "z")


def test_pixels_without_value_are_counted(run, scene):
    gaps = DISPARITY.copy()
    gaps[0, :3], gaps[1, :2] = np.nan, -100.0
    np.save("gaps.npy", gaps)
    _, out, _ = run("gaps.npy", "depth.png", "--to", "depth", "--scene", scene)
    assert "2 pixels infinite, 3 pixels without value" in out.splitlines()[-1]
    _, out, _ = run("gaps.npy", "cloud.ply", "--scene", scene)
    assert "5 pixels without a point in space are left out" in out
    assert run("depth.png", "depth.npy")[0] == 0
    depth = np.load("depth.npy")
    assert np.isnan(depth[0, :3]).all()
    assert np.isposinf(depth[1, :2]).all()


def test_normals_of_a_wall_face_the_viewer(run, scene, tolerance):
    np.save("wall.npy", np.full((HEIGHT, WIDTH), 0.1))
    assert run("wall.npy", "normals.npy", "--to", "normals", "--scene", scene)[0] == 0
    np.testing.assert_allclose(
        np.load("normals.npy"),
        np.broadcast_to([0.0, 0.0, 1.0], (HEIGHT, WIDTH, 3)),
        **tolerance("absolute"),
    )
    assert run("wall.npy", "normals.png", "--to", "normals", "--scene", scene)[0] == 0
    colours = np.asarray(Image.open("normals.png"))
    assert (colours == [128, 128, 255]).all()


def test_a_picture_is_in_colour_and_not_read_as_a_map(run, scene):
    assert run("disparity.npy", "look.png", "--picture")[0] == 0
    assert np.asarray(Image.open("look.png").convert("RGB")).std(axis=-1).max() > 50
    code, _, err = run("look.png", "back.npy")
    assert code == 2
    assert "in colour" in err
    depth = ("disparity.npy", "far.png", "--to", "depth", "--scene", scene, "--picture")
    assert "picture of" in run(*depth)[1]


def test_pngs_of_other_programs_need_their_scale(run):
    codes = np.arange(HEIGHT * WIDTH, dtype=np.uint16).reshape(HEIGHT, WIDTH)
    Image.fromarray(codes).save("kitti.png")
    code, _, err = run("kitti.png", "map.npy")
    assert code == 2
    assert "--scale S --offset O" in err
    assert run("kitti.png", "map.npy", "--scale", 1 / 256, "--offset", -1)[0] == 0
    np.testing.assert_allclose(np.load("map.npy"), codes / 256.0 - 1.0)


def test_an_existing_file_is_replaced_only_with_overwrite(run):
    np.save("mine.npy", [1, 2, 3])
    code, _, err = run("disparity.pfm", "mine.npy")
    assert code == 2
    assert "pass --overwrite" in err
    assert np.load("mine.npy").tolist() == [1, 2, 3]
    assert run("disparity.pfm", "mine.npy", "--overwrite")[0] == 0
    np.testing.assert_array_equal(np.load("mine.npy"), DISPARITY)


def test_a_map_of_another_size_than_the_camera_is_warned_about(run, scene):
    resolution = "image_resolution_x_px = 24\nimage_resolution_y_px = 48"
    text = CONFIG.replace("image_resolution_x_px = 24", resolution)
    (scene / "parameters.cfg").write_text(text)
    code, _, err = run("disparity.pfm", "depth.npy", "--to", "depth", "--scene", scene)
    assert code == 0
    assert "is for views of 48x24 pixels (rows x columns), but the map has 20x24" in err


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("absent.pfm", "map.npy"), "absent.pfm: there is no such file"),
        (("disparity.pfm", "map.tif"), "use one of the suffixes .npy, .pfm, .ply, .png"),
        (("disparity.pfm", "map.ply", "--to", "depth"), "depth cannot be written as .ply"),
        (("disparity.pfm", "map.npy", "--to", "points"), "use the suffix .ply"),
        (("disparity.pfm", "map.npy", "--picture"), "a picture is a .png"),
        (("disparity.pfm", "n.png", "--to", "normals", "--picture"), "leave out --picture"),
        (("disparity.pfm", "map.npy", "--to", "depth"), "pass --parameters FILE, or --scene"),
        (("disparity.pfm", "map.npy", "--to", "normals"), "none is next to the map"),
        (("disparity.pfm", "map.npy", "--to", "depth", "--scene", "."), ". has none"),
        (("disparity.pfm", "map.npy", "--to", "depth", "--parameters", "no.cfg"), "no.cfg"),
        (("disparity.pfm", "map.npy", "--scene", "."), "already holds disparity"),
        (("disparity.pfm", "depth.npy"), "its name says depth, but disparity would be written"),
        (("disparity.pfm", "normals.png"), "its name says normals, but disparity"),
        (
            ("disparity.pfm", "cloud.ply", "--from", "depth"),
            "to points needs the camera",
        ),
        (("disparity.pfm", "../here/disparity.pfm", "--overwrite"), "is the map itself"),
        (("disparity.pfm", "disparity.npy/map.npy"), "disparity.npy"),
        (("disparity.pfm", 300 * "n" + ".npy"), "file name too long"),
        (("disparity.pfm", "map.npy", "--scale", "2"), "apply only to a PNG"),
    ],
)
def test_refused_arguments_give_one_line_and_code_2_and_no_file(run, arguments, reason, tmp_path):
    code, _, err = run(*arguments)
    assert code == 2
    assert err.startswith("occjax: ")
    assert err.count("\n") == 1
    assert reason in err
    assert {path.name for path in (tmp_path / "here").iterdir()} == {
        "disparity.npy",
        "disparity.pfm",
    }


def test_the_help_has_one_example_per_line(run):
    code, out, _ = run("--help")
    assert code == 0
    for example in (
        "$ occjax convert disparity.pfm disparity.npy\n",
        "$ occjax convert disparity.pfm depth.pfm --to depth --scene SCENE\n",
        "$ occjax convert disparity.pfm cloud.ply --scene SCENE\n",
    ):
        assert example in out


def test_the_colours_of_the_centre_view_are_not_those_of_another_view(run, scene, corner_result):
    code, _, err = run(corner_result, "cloud.ply", "--scene", scene)
    assert code == 2
    assert "is of the view (0, 8), but the colours of --scene are those of the centre view" in err
    assert run(corner_result, "cloud.ply")[0] == 0
