"""Samples of NumPy arrays, batches, and selections of views."""

import numpy as np
import pytest

from occjax.data.samples import numpy_sample, select_views, stack_samples, to_device
from occjax.errors import InputError
from occjax.lightfield import view_offsets


def sample_of(grid, size=(2, 3)):
    """A sample whose views and visibility follow from the view's offset."""
    offsets = view_offsets(*grid)
    views = np.tile((100 * offsets[..., 0] + offsets[..., 1])[..., None, None], size)
    return numpy_sample(views, offsets, np.zeros(size, np.float32), visibility=views > 0)


@pytest.mark.parametrize("convert", [lambda sample: sample, to_device])
@pytest.mark.parametrize(("selection", "shape"), [("star", (1, 17)), ((3, 4), (3, 4))])
def test_views_offsets_and_visibility_are_selected_together(convert, selection, shape):
    sample = convert(sample_of((5, 5)))
    found = select_views(sample, selection)
    assert found.views.shape[:2] == shape
    assert all(isinstance(field, type(sample.views)) for field in found)
    offsets = np.asarray(found.offsets)
    np.testing.assert_array_equal(found.views[..., 0, 0], 100 * offsets[..., 0] + offsets[..., 1])
    np.testing.assert_array_equal(found.visibility, np.asarray(found.views) > 0)
    assert select_views(sample, "all") is sample


def test_unknown_visibility_and_validity_are_true():
    sample = numpy_sample(np.zeros((1, 2, 3, 4)), view_offsets(1, 2), np.zeros((3, 4)))
    assert sample.visibility.shape == (1, 2, 3, 4)
    assert sample.visibility.all()
    assert sample.valid.all()


def test_samples_of_one_shape_are_stacked():
    batch = to_device(stack_samples([sample_of((3, 3))] * 2))
    assert batch.views.shape == (2, 3, 3, 2, 3)
    with pytest.raises(InputError, match=r"views of \[3, 3, 2, 3\] and \[3, 3, 4, 3\]"):
        stack_samples([sample_of((3, 3)), sample_of((3, 3), (4, 3))])
