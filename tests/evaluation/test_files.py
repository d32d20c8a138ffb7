import h5py
import numpy as np
import pytest

from occjax.errors import InputError
from occjax.evaluation import evaluate_files


def write_pfm(path, image):
    """The format by its definition: header, then little-endian rows from the bottom up."""
    header = f"Pf\n{image.shape[1]} {image.shape[0]}\n-1\n".encode()
    path.write_bytes(header + image[::-1].astype("<f4").tobytes())


def npy_header(shape):
    """An NPY file of float64 that ends where its values should start, by the format's text."""
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


def test_the_papers_column_for_cotton(shared):
    folder = shared / "data" / "hci" / "cotton_maps"
    metrics = evaluate_files(folder / "occcasnet_published.pfm", folder / "gt_disp_lowres.pfm")
    shown = [f"{percent:.3f}" for percent in metrics.badpix.values()]
    assert list(metrics.badpix) == [0.07, 0.03, 0.01]
    assert shown == ["0.263", "0.569", "3.057"]
    assert f"{metrics.mse_x100:.3f}" == "0.201"
    assert metrics.pixels == 482 * 482


def test_pfm_and_npy_are_compared_row_by_row(tmp_path):
    truth = np.arange(12.0, dtype=np.float32).reshape(3, 4)
    write_pfm(tmp_path / "truth.pfm", truth)
    np.save(tmp_path / "estimate.npy", truth + np.array([[0.0], [0.0], [0.5]]))
    metrics = evaluate_files(
        tmp_path / "estimate.npy", str(tmp_path / "truth.pfm"), thresholds=(0.1,), border=0
    )
    assert metrics.badpix == {0.1: pytest.approx(100 / 3)}
    assert metrics.mse_x100 == pytest.approx(100 * 0.25 / 3)


def test_a_folder_of_results_stands_for_the_map_in_it(tmp_path):
    (tmp_path / "scene").mkdir()
    truth = np.arange(12.0, dtype=np.float32).reshape(3, 4)
    write_pfm(tmp_path / "scene" / "disparity.pfm", truth + 0.5)
    np.save(tmp_path / "truth.npy", truth)
    metrics = evaluate_files(tmp_path / "scene", tmp_path / "truth.npy", border=0)
    assert metrics.mse_x100 == pytest.approx(25.0)


def test_whole_numbers_are_disparities_too(tmp_path):
    # In uint8 the difference would wrap around.
    np.save(tmp_path / "estimate.npy", np.full((3, 4), 2, np.uint8))
    np.save(tmp_path / "truth.npy", np.full((3, 4), 3, np.uint8))
    metrics = evaluate_files(tmp_path / "estimate.npy", tmp_path / "truth.npy", border=0)
    assert metrics.mse_x100 == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("bad.npy", lambda path: None, "no such file"),
        ("bad.pfm", lambda path: None, "no such file"),
        (
            "bad.txt",
            lambda path: path.write_bytes(b"1 2"),
            r"pass a .pfm, .npy, .png, .tif or .exr file",
        ),
        ("bad.png", lambda path: path.write_bytes(b"png"), "cannot be decoded"),
        ("bad.pfm", lambda path: path.write_bytes(b"P5 2 2"), "not a PFM file"),
        ("bad.npy", lambda path: path.write_bytes(b""), "as a NumPy file"),
        ("bad.npy", lambda path: path.write_bytes(b"\x93NUMPY\x01\x00"), "as a NumPy file"),
        ("bad.npy", lambda path: np.save(path, np.array([None])), "as a NumPy file"),
        ("bad.npy", lambda path: path.write_bytes(npy_header((2**25, 2**25))), "GB of data"),
        ("bad.npy", lambda path: path.write_bytes(npy_header((2**62, 2**62))), "GB of data"),
        ("bad.npy", lambda path: np.save(path, np.zeros((3, 4), complex)), "real numbers"),
        ("bad.npy", lambda path: np.save(path, np.zeros((3, 4), bool)), "real numbers"),
        ("bad.npz", lambda path: np.savez(path, np.zeros((3, 4))), r"save .* as a \.npy file"),
        ("bad", lambda path: path.mkdir(), r"no disparity\.pfm; pass .* or a \.pfm, \.npy"),
        ("bad.npy", lambda path: np.save(path, np.zeros((3, 4, 3))), r"holds \[3, 4, 3\]"),
        ("bad.npy", lambda path: np.save(path, np.zeros((0, 4))), r"holds \[0, 4\]"),
        ("bad.npy", lambda path: np.save(path, np.zeros((3, 5))), "same scene and resolution"),
    ],
)
@pytest.mark.parametrize("bad_side", ["estimate", "ground truth"])
def test_a_file_that_cannot_be_used_is_named_in_one_line(tmp_path, name, write, message, bad_side):
    good, bad = tmp_path / "good.npy", tmp_path / name
    np.save(good, np.zeros((3, 4)))
    write(bad)
    pair = (bad, good) if bad_side == "estimate" else (good, bad)
    with pytest.raises(InputError, match=message) as caught:
        evaluate_files(*pair, border=0)
    assert str(bad) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_ground_truth_of_an_hdf5_scene_is_that_of_its_depth(tmp_path):
    """``d = B f / Z - shift``: 0.1 * 60 / 4 - 1 = 0.5."""
    with h5py.File(tmp_path / "scene.h5", "w") as file:
        file["LF"] = np.random.default_rng(0).integers(0, 256, (3, 3, 16, 20, 3), np.uint8)
        file["GT_DEPTH"] = np.full((3, 3, 16, 20), 4.0, np.float32)
        file.attrs.update(dH=0.1, focalLength=60.0, shift=1.0)
    np.save(tmp_path / "estimate.npy", np.full((16, 20), 0.75))
    metrics = evaluate_files(tmp_path / "estimate.npy", tmp_path / "scene.h5", border=0)
    assert metrics.mse_x100 == pytest.approx(100 * 0.25**2)
    with h5py.File(tmp_path / "scene.h5", "a") as file:
        del file["GT_DEPTH"]
    with pytest.raises(InputError, match=r"scene\.h5: has no ground truth"):
        evaluate_files(tmp_path / "estimate.npy", tmp_path / "scene.h5")
