"""Files of small light fields, for tests of the readers."""

import struct
import zlib

import numpy as np
from PIL import Image

CONFIG = """[intrinsics]
focal_length_mm = 100.0
image_resolution_x_px = 24
sensor_size_mm = 35.0
fstop = 100.0
[extrinsics]
num_cams_x = 3
num_cams_y = 3
baseline_mm = 50.0
focus_distance_m = 7.2
[meta]
scene = boxes
category = training
disp_min = -1.6
disp_max = 1.5
frustum_disp_min = -2.0
"""


def png(*chunks):
    """Return a PNG file of chunks, each the name and the content."""
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in (*chunks, (b"IEND", b""))
    )


def npy_header(shape):
    """Return the header of an .npy file of bytes."""
    text = f"{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def save_views(folder, views, name):
    """Write each view to the file ``name(v, u)``; missing folders are created."""
    folder.mkdir(parents=True, exist_ok=True)
    for v, u in np.ndindex(*views.shape[:2]):
        path = folder / name(v, u)
        path.parent.mkdir(exist_ok=True)
        Image.fromarray(views[v, u]).save(path)
    return folder


def hci(v, u):
    return f"input_Cam{3 * v + u:03d}.png"
