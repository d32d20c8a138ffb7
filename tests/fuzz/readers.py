"""The readers, each with valid bytes and a call; and what happens to damaged ones."""

import dataclasses
import io
import json
import re
import struct
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import imagecodecs
import numpy as np
import OpenEXR
import scipy.io
import tifffile
from PIL import Image
from safetensors.numpy import save

from experiments.submission import check_submission
from occjax.data.pool import read_sample, write_sample
from occjax.data.samples import numpy_sample
from occjax.errors import InputError
from occjax.evaluation.scene_files import read_mask, read_seconds
from occjax.io import read_arrays, read_image, read_map, read_pfm, write_map, write_pfm
from occjax.io.arrays import check_ground_truth
from occjax.io.containers import read_container
from occjax.io.folders import read_folder
from occjax.io.maps import Map
from occjax.io.mosaics import read_mosaic
from occjax.io.naming import find_views
from occjax.io.positions import gantry_grid, read_positions
from occjax.io.run_folder import open_run_folder
from occjax.models.config_json import config_to_json
from occjax.models.occcasnet import keras_weights
from occjax.models.registry import preset
from occjax.models.weights import load_weights
from occjax.results.summary import read_summary
from occjax.training.logging import read_log
from occjax.training.prepared import PROPOSAL_FIELDS, TRUTH_FIELDS, VOLUME_FIELDS, read_prepared
from tests.io.files import CONFIG, hci, save_views

RNG = np.random.default_rng(0)
IMAGE = np.kron(RNG.integers(0, 256, (4, 5, 3)), np.ones((4, 4, 1))).astype(np.uint8)
VIEWS = RNG.integers(0, 256, (3, 3, 8, 10, 3), np.uint8)
SETTINGS = {"seed": 1, "sides": [3, 4], "scenes": {"grid": [9, 9], "noise": 0.01}}
CAMERA = {"focal_length_mm": 100.0, "sensor_size_mm": 35.0, "baseline_mm": 50.0}


@dataclasses.dataclass(frozen=True)
class Reader:
    """A reader of one kind of file.

    Attributes:
        name: Name for the table.
        file: Name of the file.
        call: Called with the path of the file.
        seeds: Valid contents, which are damaged.
        wrap: Turns damaged content into a file: recomputes checksums, or adds the archive.
        folder: Writes the other files of the folder.
    """

    name: str
    file: str
    call: Callable
    seeds: tuple[bytes, ...]
    wrap: Callable[[bytes], bytes] = bytes
    folder: Callable[[Path], object] = lambda folder: None


def outcome(reader, folder, data):
    """Read damaged content; return "accepted", "refused", or the type of another exception."""
    path = folder / reader.file
    path.write_bytes(reader.wrap(data))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", UserWarning)  # those of the library are
        try:
            reader.call(path)
        except InputError:
            return "refused"
        except Exception as error:
            return f"{type(error).__name__}: {error}"
    return "accepted"


def written(name, write):
    """Return the content of a file that a function writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return path.read_bytes()


def image(name, pixels=IMAGE, **options):
    return written(name, lambda path: Image.fromarray(pixels).save(path, **options))


def tiff(pixels=IMAGE, **options):
    return written("a.tif", lambda path: tifffile.imwrite(path, pixels, **options))


def exr(compression):
    planes = {name: IMAGE[..., c].astype(np.float32) for c, name in enumerate("RGB")}
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    return written("a.exr", lambda path: OpenEXR.File(header, planes).write(str(path)))


def npy(array):
    return written("a.npy", lambda path: np.save(path, array))


def hdf5(write, **options):
    def save(path):
        with h5py.File(path, "w", **options) as file:
            write(file)

    return written("a.h5", save)


def old_hci(file):
    file.attrs.update({"dH": 0.1, "focalLength": 500.0, "shift": 10.0})
    file.create_dataset("LF", data=VIEWS, chunks=(1, 1, 8, 10, 3), compression="gzip")
    file["GT_DEPTH"] = np.full((3, 3, 8, 10), 5.0)


def matlab(compressed):
    arrays = {"LF": VIEWS}
    return written("a.mat", lambda path: scipy.io.savemat(path, arrays, do_compression=compressed))


def keras(file):
    group = file.create_group("model_weights")
    group.attrs["layer_names"] = [b"conv2d", b"batch_normalization"]
    for layer, weights in (("conv2d", ["kernel"]), ("batch_normalization", ["gamma", "beta"])):
        names = [f"{layer}/{weight}:0" for weight in weights]
        group.create_group(layer).attrs["weight_names"] = [name.encode() for name in names]
        for name in names:
            group[f"{layer}/{name}"] = np.ones((3, 3, 2), np.float32)


def read_keras(path):
    keras_weights.group_by_layer(path, keras_weights.read_arrays(path))


def archive(entries, **options):
    """Return a zip archive."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED, **options) as file:
        for name, content in entries.items():
            file.writestr(name, content)
    return data.getvalue()


def joined_npy(arrays):
    return b"".join(npy(np.asarray(array)) for array in arrays.values())


def as_npz(names, data):
    """Return an .npz of damaged .npy files, which follow each other in the data."""
    parts = re.split(rb"(?=\x93NUMPY)", data)
    return archive({f"{name}.npy": part for name, part in zip(names, parts[1:], strict=False)})


def with_checksums(data):
    """Return a PNG whose chunks have the right checksums, as far as their lengths are right."""
    repaired, place = data[:8], 8
    while place + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, place)
        body = data[place + 4 : place + 8 + length]
        repaired += data[place : place + 4] + body + struct.pack(">I", zlib.crc32(body))
        place += 12 + length
    return repaired + data[place:]


def radiance():
    rows = b"".join(bytes([*pixel, 128]) for row in IMAGE for pixel in row)
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 20\n" + rows


def submission(data):
    """Return a submission with a damaged map and a damaged runtime, separated by a mark."""
    disparity, _, runtime = data.partition(b"|")
    return archive({"disp_maps/dots.pfm": disparity, "runtimes/dots.txt": runtime})


def safetensors(**arrays):
    return save(arrays, metadata={"config": config_to_json(preset("photometric"))})


def configured(data):
    """Return a safetensors file with a damaged configuration."""
    return save({}, metadata={"config": data.decode(errors="replace")})


def read_names(path):
    names = path.read_bytes().decode(errors="replace").split("\n")
    layout, named = find_views(
        "folder", {name for name in names if 0 < len(name) < 256 and "/" not in name}
    )
    if layout == "stanford":
        gantry_grid("folder", named)


def scene(folder):
    """Write a folder of three views and their camera."""
    save_views(folder, VIEWS[:1], hci)
    (folder / "parameters.cfg").write_text(CONFIG.replace("num_cams_y = 3", "num_cams_y = 1"))


def of_folder(function, *arguments):
    return lambda path: function(path.parent, *arguments)


FIELDS = {
    "views": VIEWS.astype(">u2"),
    "ground_truth": np.zeros((8, 10)),
    "positions": np.stack(np.mgrid[:3, :3], axis=-1),
    "disparity_range": np.array([-1.0, 2.0]),
    "usable": np.ones((3, 3), bool),
}
SAMPLE = numpy_sample(
    views=np.zeros((3, 3, 8, 10), np.float32),
    offsets=np.zeros((3, 3, 2), np.float32),
    disparity=np.zeros((8, 10), np.float32),
)
SIZES = {"h": 8, "w": 10, "k": 4, "13": 13, "d": 5, "4": 4}


def zeros_of(kinds):
    return {
        name: np.zeros([SIZES[axis] for axis in kind.dim_str.split()], kind.dtypes[0])
        for name, kind in {**kinds, **TRUTH_FIELDS}.items()
    }


PREPARED_PROPOSALS, PREPARED_VOLUME = zeros_of(PROPOSAL_FIELDS), zeros_of(VOLUME_FIELDS)


def sample_fields():
    with np.load(io.BytesIO(written("a.npz", lambda path: write_sample(path, SAMPLE)))) as file:
        return dict(file)


GREY16 = RNG.integers(0, 65536, (16, 20), np.uint16)
COLOUR16 = imagecodecs.png_encode(RNG.integers(0, 65536, (9, 8, 3), np.uint16))
VALUE_PNG = written(
    "a.png", lambda path: write_map(path, Map(np.linspace(0, 3, 80).reshape(8, 10), "depth"))
)
NAMES = [
    [hci(v, u) for v, u in np.ndindex(3, 3)],
    [f"scene_{v:02d}_{u:02d}.png" for v, u in np.ndindex(3, 3)],
    [f"out_{v:02d}_{u:02d}_{v}.5_{u}.5_.png" for v, u in np.ndindex(3, 3)],
    [f"view {v + 1},{u - 1} of 9.jpg" for v, u in np.ndindex(3, 3)],
]
_, NAMED = find_views("folder", NAMES[0], grid=(3, 3))
SUMMARY = {
    "calibration": {**CAMERA, "focus_distance_m": None},
    "seconds": {"run": 1.5},
    **dict.fromkeys(("scene", "source", "model", "weights", "versions", "notes")),
    "grid": [3, 3],
    "image_size": [8, 9],
    "searched_disparity_range": [-1.0, 1.0],
}
LOG = [{"kind": "train", "step": 50 * n, "loss": 0.3, "badpix": None} for n in range(5)]

READERS = (
    Reader("npy", "a.npy", read_arrays, (npy(VIEWS), npy(VIEWS / 255.0))),
    Reader(
        "npz",
        "a.npz",
        read_arrays,
        (written("a.npz", lambda path: np.savez_compressed(path, **FIELDS)),),
    ),
    Reader(
        "npz, entries", "a.npz", read_arrays, (joined_npy(FIELDS),), partial(as_npz, list(FIELDS))
    ),
    Reader(
        "run description",
        "run.json",
        lambda path: open_run_folder(path.parent, path.name, SETTINGS, contents="a run"),
        (json.dumps(SETTINGS).encode(),),
    ),
    Reader(
        "run log",
        "log.jsonl",
        of_folder(read_log),
        ("\n".join(map(json.dumps, LOG)).encode(),),
    ),
    Reader(
        "summary",
        "summary.json",
        lambda path: (read_summary(path), read_seconds(path.parent)),
        (json.dumps(SUMMARY).encode(),),
    ),
    Reader(
        "HDF5",
        "a.h5",
        read_container,
        (hdf5(old_hci), hdf5(lambda file: file.create_dataset("LF", data=VIEWS))),
    ),
    Reader(
        "MATLAB",
        "a.mat",
        read_container,
        tuple(matlab(compressed) for compressed in (False, True)),
    ),
    Reader("Keras weights", "a.h5", read_keras, (hdf5(keras),)),
    Reader(
        "PNG",
        "a.png",
        read_image,
        (image("a.png"), image("a.png", IMAGE[..., 0]), image("a.png", GREY16), COLOUR16),
    ),
    Reader(
        "PNG, right checksums",
        "a.png",
        read_image,
        (image("a.png"), image("a.png", GREY16), COLOUR16),
        with_checksums,
    ),
    Reader(
        "TIFF",
        "a.tif",
        read_image,
        (
            tiff(photometric="rgb"),
            tiff(compression="zlib", photometric="rgb"),
            tiff(IMAGE.astype(np.float32), compression="lzw", photometric="rgb"),
            tiff(GREY16, byteorder=">"),
            image("a.tif", compression="jpeg"),
        ),
    ),
    Reader(
        "JPEG",
        "a.jpg",
        read_image,
        (image("a.jpg"), image("a.jpg", progressive=True), image("a.jpg", IMAGE[..., 0])),
    ),
    Reader("BMP", "a.bmp", read_image, (image("a.bmp"), image("a.bmp", IMAGE[..., 0]))),
    Reader(
        "EXR",
        "a.exr",
        read_image,
        (exr(OpenEXR.ZIP_COMPRESSION), exr(OpenEXR.NO_COMPRESSION), exr(OpenEXR.PIZ_COMPRESSION)),
    ),
    Reader("Radiance", "a.hdr", read_image, (radiance(),)),
    Reader(
        "folder, a view",
        hci(0, 2),
        of_folder(read_folder),
        (image("a.png", VIEWS[0, 2]),),
        folder=scene,
    ),
    Reader(
        "folder, file names", "names.txt", read_names, tuple("\n".join(n).encode() for n in NAMES)
    ),
    Reader(
        "folder, parameters.cfg",
        "parameters.cfg",
        of_folder(read_folder),
        (CONFIG.encode(),),
        # Names of rows and columns: whether views are numbered row by row is found by JAX.
        folder=lambda folder: save_views(folder, VIEWS, lambda v, u: f"{v}_{u}.png"),
    ),
    Reader(
        "positions.csv",
        "positions.csv",
        of_folder(read_positions, NAMED),
        (b"row,column\n" + b"".join(b"%d,%.1f\n" % index for index in np.ndindex(3, 3)),),
    ),
    Reader(
        "positions.npy",
        "positions.npy",
        of_folder(read_positions, NAMED),
        (npy(np.stack(np.mgrid[:3, :3], axis=-1) * 1.5),),
    ),
    Reader(
        "ground truth",
        "gt_disp_lowres.pfm",
        lambda path: check_ground_truth(path, read_pfm(path), (8, 10)),
        (written("a.pfm", lambda path: write_pfm(path, np.zeros((8, 10)))),),
    ),
    Reader(
        "quilt",
        "tiles_qs3x2.png",
        lambda path: read_mosaic(path, None, None),
        (image("a.png", IMAGE[:, :18]),),
        with_checksums,
    ),
    Reader("mask", "mask_a.png", of_folder(read_mask, "a", (16, 20)), (image("a.png"),)),
    Reader(
        "PFM",
        "a.pfm",
        read_pfm,
        (
            written("a.pfm", lambda path: write_pfm(path, RNG.random((20, 20)))),
            b"PF # colour\n2 1\n1.0\n" + bytes(24),
        ),
    ),
    Reader(
        "submission",
        "a.zip",
        lambda path: check_submission(path, scenes=("dots",), size=(2, 2)),
        (submission(b"Pf\n2 2\n-1.0\n" + bytes(16) + b"|1.5\n"),),
    ),
    Reader(
        "submission, entries",
        "a.zip",
        lambda path: check_submission(path, scenes=("dots",), size=(2, 2)),
        (b"Pf\n2 2\n-1.0\n" + bytes(16) + b"|1.5\n",),
        submission,
    ),
    Reader(
        "pool sample",
        "000000.npz",
        read_sample,
        (joined_npy(sample_fields()),),
        partial(as_npz, list(sample_fields())),
    ),
    Reader(
        "prepared proposals",
        "000000.npz",
        read_prepared,
        (joined_npy(PREPARED_PROPOSALS),),
        partial(as_npz, list(PREPARED_PROPOSALS)),
    ),
    Reader(
        "prepared volume",
        "000000.npz",
        partial(read_prepared, volume=True),
        (joined_npy(PREPARED_VOLUME),),
        partial(as_npz, list(PREPARED_VOLUME)),
    ),
    Reader("map in a PNG", "a.png", read_map, (VALUE_PNG,), with_checksums),
    Reader("map in an npy", "a.npy", read_map, (npy(np.ones((8, 10))), npy(np.eye(8, dtype=int)))),
    Reader(
        "safetensors",
        "a.safetensors",
        load_weights,
        (safetensors(), safetensors(kernel=np.ones((3, 2), np.float32))),
    ),
    Reader(
        "safetensors, configuration",
        "a.safetensors",
        load_weights,
        (config_to_json(preset("photometric")).encode(),),
        configured,
    ),
)
