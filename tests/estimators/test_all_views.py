"""All views: estimated one by one by a stub, compared, filled, written and fused."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.estimators import Estimate, estimate, estimate_all_views
from occjax.estimators.protocol import ModelInputs
from occjax.lightfield import LightField
from tests.scenes import two_plane_maps

WRONG = np.s_[1:4, 1:4]
"""Part of the centre view that the stub gets wrong."""


@dataclass(frozen=True)
class Oracle:
    """An estimator that knows the maps of two planes; one part of the centre view is wrong."""

    variables: dict = field(default_factory=dict, compare=False)
    name: str = "oracle"

    def prepare(self, light_field, disparity_range):
        view = light_field.view or (1, 1)
        disparity = two_plane_maps()[view]
        if view == (1, 1):
            disparity[WRONG] = 1.0
        return ModelInputs({}, disparity, (), (-4.0, 4.0))

    def run(self, variables, views):
        return views

    def finish(self, inputs, outputs):
        ones = np.ones_like(outputs)
        return Estimate(outputs, ones, ones, inputs.disparity_range, self.name)


@pytest.fixture(scope="module")
def light_field():
    """Views whose red channel shows the disparity."""
    views = np.zeros((3, 3, 24, 24, 3), np.uint8)
    views[..., 0] = 60 + 60 * two_plane_maps()
    return LightField(views, disparity_range=(-4.0, 4.0))


@pytest.fixture(scope="module")
def result(light_field):
    """The estimate of all views."""
    return estimate(light_field, model=Oracle(), all_views=True)


def test_what_other_views_contradict_is_filled_from_them(result):
    assert (result.disparity[WRONG] == 1.0).all()  # the estimate of the centre view alone
    np.testing.assert_array_equal(result.views.disparity, two_plane_maps())
    expected = np.zeros((24, 24), bool)
    expected[WRONG] = True
    np.testing.assert_array_equal(result.views.filled[1, 1], expected)
    assert (result.views.consistency[1, 1][WRONG] == 1.0).all()


def test_views_without_a_map_have_no_consistency(light_field):
    usable = np.ones((3, 3), bool)
    usable[0, 0] = False
    views = estimate_all_views(Oracle(), replace(light_field, usable=usable))
    np.testing.assert_array_equal(np.isnan(views.disparity).any((2, 3)), ~usable)
    for maps in (views.consistency, views.agreeing):
        assert not maps[0, 0].any()
        assert maps[0, 1].any()


def test_one_view_is_not_all_views(light_field):
    with pytest.raises(InputError, match="has one view"):
        estimate_all_views(Oracle(), light_field.central(1, 1))
    with pytest.raises(InputError, match="not both"):
        estimate(light_field, model=Oracle(), view=(0, 0), all_views=True)


def test_maps_and_cloud_of_all_views_are_written_and_read(result, tmp_path):
    outputs = result.save(tmp_path / "out", what="maps")
    names = {path.relative_to(outputs.folder).as_posix() for path in outputs.paths}
    assert {"views.npz", "views.ply", "views/disparity_02_01.pfm"} <= names
    again = Estimate.load(tmp_path / "out").views
    np.testing.assert_array_equal(again.disparity, result.views.disparity)
    np.testing.assert_array_equal(again.consistency, result.views.consistency)
    fewer = result.views._replace(disparity=result.views.disparity.copy())
    fewer.disparity[2, 1] = np.nan  # a view that could not be estimated has no file
    replace(result, views=fewer).save(tmp_path / "out", what="maps")
    left = sorted(path.name for path in (tmp_path / "out/views").iterdir())
    assert "disparity_02_01.pfm" not in left
    assert "disparity_02_02.pfm" in left
    replace(result, views=None).save(tmp_path / "out", what="maps")
    assert not list((tmp_path / "out").glob("views*"))
