"""Videos and animated images, written atomically; the suffix of the file name gives the format."""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from occjax.errors import InputError
from occjax.io.atomic import atomic_path

VIDEO_SUFFIXES = (".mp4", ".webp", ".gif")
"""Suffixes of video files, in lower case; ``.mp4`` needs the extra ``video``."""


def check_video(path: Path, frames_per_second: float) -> None:
    """Verify that a video can be encoded, before its frames are computed.

    Raises:
        InputError: If the suffix is not one of :data:`VIDEO_SUFFIXES`, the extra is missing, or the
            rate is not above 0 and at most 1000.

    Example:
        >>> check_video(Path("sweep.webp"), 29.97)
    """
    if not 0.0 < frames_per_second <= 1000.0:
        raise InputError(
            f"the rate is {frames_per_second:g} frames/s; pass more than 0, up to 1000"
        )
    suffix = path.suffix.lower()
    if suffix not in VIDEO_SUFFIXES:
        raise InputError(
            f"{path}: a sequence of images needs the suffix {', '.join(VIDEO_SUFFIXES[:-1])} or "
            f"{VIDEO_SUFFIXES[-1]}; rename it"
        )
    if suffix == ".mp4" and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise InputError(
            f"{path}: an .mp4 needs imageio-ffmpeg; run pip install 'occjax[video]', or write a "
            ".webp"
        )


def write_video(
    path: str | Path, frames: Iterable[np.ndarray], *, frames_per_second: float = 12.0
) -> int:
    """Write a video atomically; ``.webp`` and ``.gif`` repeat without end.

    Args:
        path: ``.mp4`` (H.264, for which an odd number of rows or columns is extended by one),
            animated ``.webp`` or ``.gif`` (256 colours); an existing file is replaced.
        frames: Images ``[H, W, 3]`` uint8 RGB of one size, at least one.
        frames_per_second: Rate of display.

    Returns:
        The number of frames.

    Raises:
        InputError: As :func:`check_video`, and if there is no frame or the file cannot be written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "blink.gif"
        >>> write_video(path, (np.full((8, 8, 3), level, np.uint8) for level in (0, 255)))
        2
        >>> with Image.open(path) as image:
        ...     image.n_frames
        2
    """
    path = Path(path)
    check_video(path, frames_per_second)
    remaining, count = iter(frames), 0
    first = next(remaining, None)
    if first is None:
        raise InputError(f"{path}: there is no frame to write; pass at least one")

    def all_frames() -> Iterator[np.ndarray]:
        nonlocal count
        for frame in chain([first], remaining):
            count += 1
            yield frame

    with atomic_path(path) as temporary:
        if path.suffix.lower() == ".mp4":
            _write_mp4(temporary, all_frames(), first.shape, frames_per_second)
        else:
            images = (Image.fromarray(frame) for frame in all_frames())
            lossy: dict[str, Any] = {"quality": 85} if path.suffix.lower() == ".webp" else {}
            next(images).save(
                temporary,
                save_all=True,
                append_images=images,
                duration=round(1000 / frames_per_second),
                loop=0,
                **lossy,
            )
    return count


def _write_mp4(
    path: Path, frames: Iterable[np.ndarray], shape: tuple[int, ...], frames_per_second: float
) -> None:
    """Encode H.264 in the pixel format that all players know, which needs even sides."""
    import imageio_ffmpeg

    height, width = shape[0] + shape[0] % 2, shape[1] + shape[1] % 2
    padding = ((0, height - shape[0]), (0, width - shape[1]), (0, 0))
    encoder = imageio_ffmpeg.write_frames(
        str(path), (width, height), fps=frames_per_second, quality=8, macro_block_size=1
    )
    with warnings.catch_warnings():
        # JAX warns of every fork; this one is followed by the start of ffmpeg.
        warnings.filterwarnings("ignore", r"os\.fork\(\) was called", RuntimeWarning)
        encoder.send(None)
    try:
        for frame in frames:
            encoder.send(np.ascontiguousarray(np.pad(frame, padding, mode="edge")))
    finally:
        encoder.close()
