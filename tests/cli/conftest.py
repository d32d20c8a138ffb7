"""A scene on disk and the command, for the tests of this folder."""

import imageio.v3 as imageio
import numpy as np
import pytest

from occjax.estimators import Estimate
from occjax.io import write_pfm
from occjax.lightfield import LightField
from tests.scenes import plane


@pytest.fixture
def run(occjax_command):
    """Run ``occjax ARGUMENTS``; returns exit code, standard output and standard error."""
    return occjax_command


@pytest.fixture(scope="session")
def write_scene():
    """Function that writes a plane in the layout of the HCI benchmark, with its ground truth."""

    def write(folder, disparity=0.5):
        folder.mkdir(parents=True)
        light_field = plane(grid=(9, 9), size=(32, 40), disparity=disparity)
        views = (light_field.views * 255).round().astype(np.uint8).reshape(81, 32, 40, 3)
        for number, view in enumerate(views):
            imageio.imwrite(folder / f"input_Cam{number:03d}.png", view)
        write_pfm(folder / "gt_disp_lowres.pfm", light_field.ground_truth)
        return folder

    return write


@pytest.fixture
def scene(tmp_path, write_scene):
    """Folder of 9x9 views of 32x40 pixels of a plane of disparity 0.5."""
    return write_scene(tmp_path / "scene")


@pytest.fixture
def result(tmp_path):
    """Folder of results with the disparity of ``scene``, except for one pixel without a value."""
    return save_plane(tmp_path / "result", view=None)


@pytest.fixture
def corner_result(tmp_path):
    """The same for the view (0, 8) of the scene."""
    return save_plane(tmp_path / "corner", view=(0, 8))


def save_plane(folder, view):
    disparity = np.full((32, 40), 0.5, np.float32)
    disparity[0, 0] = np.nan
    wall = LightField(np.zeros((9, 9, 32, 40), np.uint8))
    wall = wall if view is None else wall.around(view)
    estimate = Estimate(disparity, disparity, disparity, (-1.0, 1.0), "mine", light_field=wall)
    return estimate.save(folder, what="maps").folder
