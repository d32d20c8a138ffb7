"""Ground truth that is upside down, mirrored, negated, byte-swapped or in another unit."""

import numpy as np
import pytest

from occjax.errors import InputError
from occjax.evaluation import evaluate_files
from occjax.io import ViewOrderWarning, load, read_pfm, write_arrays, write_pfm
from occjax.lightfield import LightField
from tests.io.files import hci, save_views
from tests.io.scenes import two_planes

pytestmark = pytest.mark.filterwarnings("ignore::occjax.io.GridWarning")


def scene():
    """3x3 views; the near square is moved so that no flip leaves the truth as it is."""
    views, truth = two_planes((3, 3), (64, 72))
    return views[..., 8:64, 12:72, :], truth[8:64, 12:72]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda truth: truth[::-1], "its rows are reversed"),
        (lambda truth: truth[:, ::-1], "its columns are reversed"),
        (lambda truth: truth[::-1, ::-1], "its rows and columns are reversed"),
        (np.negative, "its sign is reversed"),
        (lambda truth: truth, None),
        (lambda truth: np.where(truth > 0, np.nan, truth), None),
    ],
)
def test_a_flipped_truth_is_named(tmp_path, recwarn, change, words):
    views, truth = scene()
    write_arrays(tmp_path / "scene.npz", LightField(views, ground_truth=change(truth)))
    load(tmp_path / "scene.npz")
    told = [str(w.message) for w in recwarn.list if w.category is ViewOrderWarning]
    assert len(told) == (words is not None)
    assert words is None or f"ground truth agrees with the views if {words}" in told[0]


@pytest.mark.parametrize("name", ["rendered/s013", "hci/antinous"])
def test_real_truth_agrees_as_it_is(shared, name):
    load(shared / "data" / name)


@pytest.mark.parametrize("scale", [b"-1.0", b"1.0"])
def test_a_byte_swapped_pfm_is_refused(tmp_path, scale):
    values = np.linspace(-1.6, 1.5, 480, dtype=np.float32).reshape(20, 24)
    swapped = values if scale == b"1.0" else values.byteswap()
    path = tmp_path / "gt_disp_lowres.pfm"
    path.write_bytes(b"Pf\n24 20\n" + scale + b"\n" + swapped.tobytes())
    sign = "negative" if scale == b"1.0" else "positive"
    with pytest.raises(InputError, match=f"other byte order; write a {sign} scale"):
        read_pfm(path)


def test_disparities_larger_than_the_views_are_refused(tmp_path):
    views = np.round(scene()[0] * 255).astype(np.uint8)
    folder = save_views(tmp_path / "scene", views, hci)
    write_pfm(folder / "gt_disp_lowres.pfm", np.full(views.shape[2:4], 850.0))
    with pytest.raises(InputError, match=r"gt_disp_lowres\.pfm: ground truth reaches 850 pixels"):
        load(folder)


def test_files_to_evaluate_are_checked(tmp_path):
    truth = np.random.default_rng(0).uniform(-1, 1, (20, 24)).astype(np.float32)
    np.save(tmp_path / "swapped.npy", truth.byteswap())
    np.save(tmp_path / "estimate.npy", truth + 0.01)
    changes = [
        (truth[::-1], "rows"),
        (truth[:, ::-1], "columns"),
        (truth[::-1, ::-1], "rows and columns"),
        (-truth, "sign"),
    ]
    for changed, words in changes:
        np.save(tmp_path / "truth.npy", changed)
        message = rf"estimate\.npy against .* if in one of them the {words} (is|are) reversed"
        with pytest.warns(UserWarning, match=message):
            evaluate_files(tmp_path / "estimate.npy", tmp_path / "truth.npy", border=0)
    with pytest.raises(InputError, match=r"swapped\.npy: disparities reach .* byte-swapped"):
        evaluate_files(tmp_path / "estimate.npy", tmp_path / "swapped.npy", border=0)
