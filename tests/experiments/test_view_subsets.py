"""Subsets of the views of a pool."""

from collections import Counter

import numpy as np
import pytest

from experiments import view_subsets
from experiments.view_subsets import Subset, draw_subset, planned_subsets
from occjax.data.pool import light_field_files, read_sample
from occjax.data.samples import numpy_sample
from occjax.errors import InputError
from occjax.lightfield import view_offsets


def draw(subset, seed=0):
    """A subset of views whose grey value is their number in the grid, row by row."""
    offsets = view_offsets(9, 9)
    views = np.arange(81.0, dtype=np.float32).reshape(9, 9, 1, 1) * np.ones((6, 8), np.float32)
    sample = numpy_sample(views, offsets, np.full((6, 8), 0.5, np.float32))
    return draw_subset(np.random.default_rng(seed), sample, subset)


@pytest.mark.parametrize(("size", "step", "count"), [(3, 4, 9), (5, 2, 17), (3, 1, 9)])
def test_grids_have_offsets_in_their_own_view_steps(size, step, count):
    subset = draw(Subset("grid", size, step))
    assert subset.views.shape == (1, count, 6, 8)
    offsets = np.asarray(subset.offsets).reshape(-1, 2)
    # The view at offset (row, column) of the 9x9 views has the number 9 (row + 4) + column + 4.
    numbers = 9 * (step * offsets[:, 0] + 4) + step * offsets[:, 1] + 4
    np.testing.assert_array_equal(subset.views[0, :, 0, 0], numbers)
    assert np.abs(offsets).max() == size // 2
    # A surface moves `step` times as far between views at `step` times the distance.
    np.testing.assert_array_equal(subset.disparity, 0.5 * step)


@pytest.mark.parametrize(("kind", "count"), [("quarter", 7), ("half", 11), ("line", 5)])
def test_other_subsets_lie_on_one_side_or_on_a_line(kind, count):
    sides = set()
    for seed in range(20):
        offsets = np.asarray(draw(Subset(kind), seed).offsets).reshape(-1, 2)
        assert len(offsets) == count
        assert not offsets[count // 2].any()
        low, high = offsets.min(axis=0), offsets.max(axis=0)
        # Of each axis: views on the lower side, on the upper side.
        sides.add((*(low < 0), *(high > 0)))
    expected = {
        "quarter": {(1, 1, 0, 0), (1, 0, 0, 1), (0, 1, 1, 0), (0, 0, 1, 1)},
        "half": {(1, 1, 0, 1), (1, 1, 1, 0), (0, 1, 1, 1), (1, 0, 1, 1)},
        "line": {(1, 0, 1, 0), (0, 1, 0, 1)},
    }
    assert {tuple(map(int, side)) for side in sides} == expected[kind]


def test_half_of_the_light_fields_have_each_kind_of_side():
    counts = Counter((subset.kind, subset.size) for _, subset in planned_subsets(360))
    sides = {("quarter", 9): 180, ("half", 9): 90, ("line", 9): 90}
    assert counts == {("grid", 3): 180, ("grid", 5): 120} | sides


@pytest.mark.slow
def test_smoke_test_writes_a_pool(tmp_path, capsys):
    view_subsets.run(tmp_path, small=True)
    files = light_field_files(tmp_path / "subsets")
    # Light field 0 gives a 3x3 and a 5x5 grid, light field 1 a quarter and a half.
    assert sorted(read_sample(file).views.shape[1] for file in files) == [7, 9, 11, 17]
    assert "4 light fields" in capsys.readouterr().out


def test_wrong_arguments_are_refused(tmp_path):
    with pytest.raises(InputError, match="or pass --small alone"):
        view_subsets.run(tmp_path)
