import io

import numpy as np
from PIL import Image, PngImagePlugin

from experiments.blender.kit.png import essential_chunks


def test_metadata_is_removed_and_pixels_are_kept():
    pixels = np.random.default_rng(0).integers(0, 256, (20, 30, 3), np.uint8)
    notes = PngImagePlugin.PngInfo()
    notes.add_text("time", "00:12")
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "png", pnginfo=notes, dpi=(72, 72))
    bare = essential_chunks(buffer.getvalue())
    picture = Image.open(io.BytesIO(bare))
    np.testing.assert_array_equal(np.asarray(picture), pixels)
    assert picture.info == {}
