"""Checks of the reference itself against activations of the published implementation."""

import numpy as np
import pytest

from tests.reference.make_fixture import LIMITS, answers, load_fixture
from tests.reference.network import Weights, average_pool, mirror, resize
from tests.reference.published_layout import (
    published_shapes,
    read_published_layout,
    write_published_layout,
)


@pytest.mark.slow
def test_reference_agrees_with_the_published_implementation(shared):
    folder = shared / "parity"
    stored = read_published_layout(folder / "official_layout_weights.h5")
    weights = Weights.from_names(stored, np.float32)  # half the time; the limits allow it
    light_field = np.load(folder / "correct_warp.npz")["light_field"]
    found = answers(weights, light_field, np.linspace(-4.0, 4.0, 33), np.linspace(-0.5, 0.5, 9))
    for warp in ("correct", "transposed"):
        with np.load(folder / f"{warp}_warp.npz") as published:
            assert set(published) == {"light_field", *LIMITS}
            for name, limit in LIMITS.items():
                difference = np.abs(found[warp][name] - published[name])
                assert difference.max() <= limit, (warp, name)
                if name.startswith("disparity"):
                    assert difference.mean() <= 5e-5, (warp, name)


def test_fixture_is_what_the_reference_computes(tolerance):
    weights, fixture = load_fixture()
    found = answers(
        Weights.from_names(weights),
        fixture["light_field"],
        fixture["coarse_candidates"],
        fixture["refined_candidates"],
    )
    for warp, named in found.items():
        assert {f"{warp}/{name}" for name in named} == {k for k in fixture if k.startswith(warp)}
        for name, array in named.items():
            np.testing.assert_allclose(array, fixture[f"{warp}/{name}"], **tolerance("absolute"))


def test_names_and_shapes_are_those_of_the_published_layout(shared):
    published = read_published_layout(shared / "parity" / "official_layout_weights.h5")
    shapes = published_shapes()
    assert list(shapes) == list(published)
    assert shapes == {name: array.shape for name, array in published.items()}


def test_published_shapes_hold_the_published_number_of_values():
    assert sum(np.prod(shape) for shape in published_shapes().values()) == 4_792_658


@pytest.mark.parametrize("first_number", [0, 7])
def test_written_file_reads_back_the_same_weights(tmp_path, first_number):
    weights, _ = load_fixture()
    write_published_layout(tmp_path / "small.h5", weights, first_number=first_number)
    read = read_published_layout(tmp_path / "small.h5")
    assert (list(read) == list(weights)) == (first_number == 0)
    for found, expected in zip(read.values(), weights.values(), strict=True):
        np.testing.assert_array_equal(found, expected)
    kernels = Weights.from_names(read).conv2d
    for found, expected in zip(kernels, Weights.from_names(weights).conv2d, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_pooling_counts_only_pixels_inside_the_image():
    image = np.arange(5.0)[None, :, None, None]
    assert average_pool(image, 4)[0, :, 0, 0].tolist() == [1.0, 3.5]
    assert average_pool(image, 16)[0, :, 0, 0].tolist() == [2.0]


def test_resizing_keeps_the_corners():
    image = np.array([0.0, 2.0, 10.0])[None, :, None, None]
    assert resize(image, (5, 1))[0, :, 0, 0].tolist() == [0.0, 1.0, 2.0, 6.0, 10.0]


def test_attention_is_symmetric_and_mirrored():
    expected = [[0, 1, 2, 1, 0], [1, 3, 4, 3, 1], [2, 4, 5, 4, 2], [1, 3, 4, 3, 1], [0, 1, 2, 1, 0]]
    assert mirror(np.arange(6.0), (5, 5)).tolist() == expected
