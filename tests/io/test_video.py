"""Videos: what is read back is what was written, within the loss of the format."""

import subprocess

import numpy as np
import pytest
from PIL import Image, ImageSequence

from occjax.errors import InputError
from occjax.io.video import VIDEO_SUFFIXES, write_video

LEVELS = (40, 120, 200)


def frames(size=(17, 22)):
    for level in LEVELS:
        yield np.broadcast_to(np.uint8([level, 80, 160]), (*size, 3)).copy()


@pytest.mark.parametrize("suffix", [".webp", ".gif"])
def test_an_animated_image_has_the_frames_and_repeats(tmp_path, suffix):
    path = tmp_path / f"video{suffix}"
    assert write_video(path, frames(), frames_per_second=10.0) == 3
    with Image.open(path) as image:
        assert image.info["loop"] == 0
        read = [np.asarray(f.convert("RGB")) for f in ImageSequence.Iterator(image)]
        assert image.info["duration"] == 100
    for actual, expected in zip(read, frames(), strict=True):
        assert np.abs(actual.astype(int) - expected).max() <= 6


def test_an_mp4_has_the_frames_and_even_sides(tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "video.mp4"
    assert write_video(path, frames()) == 3
    decode = (
        imageio_ffmpeg.get_ffmpeg_exe(),
        "-i",
        path,
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-",
    )
    done = subprocess.run(decode, capture_output=True, check=True)
    read = np.frombuffer(done.stdout, np.uint8).reshape(3, 18, 22, 3)
    for actual, expected in zip(read, frames((18, 22)), strict=True):
        assert np.abs(actual.astype(int) - expected).max() <= 6


def test_what_cannot_be_written_leaves_no_file(tmp_path):
    def broken():
        yield from frames()
        raise RuntimeError("out of frames")

    for suffix in VIDEO_SUFFIXES:
        with pytest.raises(RuntimeError, match="out of frames"):
            write_video(tmp_path / f"video{suffix}", broken())
    with pytest.raises(InputError, match="no frame"):
        write_video(tmp_path / "video.gif", [])
    with pytest.raises(InputError, match="needs the suffix"):
        write_video(tmp_path / "video.png", frames())
    assert not list(tmp_path.iterdir())
