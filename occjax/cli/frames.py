"""Videos of light fields: the frames have one camera array, one disparity range and one program."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from occjax.cli.options import ViewOrderOptions
from occjax.errors import InputError
from occjax.io.video import write_video
from occjax.layout import disparity_range_of
from occjax.lightfield import LightField
from occjax.results.outputs import MIN_CONFIDENCE
from occjax.viz.colour import disparity_norm
from occjax.viz.pictures import disparity_picture


def frame_reader(first: Path, view_order: ViewOrderOptions) -> Callable[[Path], LightField]:
    """Read and measure the first frame of a video, and return the reader of its frames.

    View order, shifts and positions of the views, and the disparity range are measured on the first
    frame and used for all: the cameras of a video do not move against each other, and frames of one
    range share a compiled program.

    Args:
        first: File or folder of the light field of the first frame.
        view_order: How the files of each frame store the views.

    Returns:
        Function that reads the light field of a frame. It raises an :class:`InputError` if that
        cannot be read, or has other views than the first frame.

    Raises:
        InputError: If the first frame cannot be read.
    """
    measured = view_order.load(first)
    disparity_range, _ = disparity_range_of(measured)

    def read(frame: Path) -> LightField:
        if frame == first:
            return measured
        light_field = view_order.load(frame, check_orientation=False)
        if light_field.views.shape != measured.views.shape:
            raise InputError(
                f"{frame}: has views {list(light_field.views.shape)}, but those of the first frame "
                f"{first} are {list(measured.views.shape)}; all frames need the same"
            )
        return dataclasses.replace(
            light_field,
            disparity_range=disparity_range,
            positions=measured.positions,
            view_order_report=measured.view_order_report,
        )

    return read


def write_disparity_video(path: Path, frames: Sequence[Path], *, frames_per_second: float) -> None:
    """Write the disparity of all frames as one video in the same colours.

    Args:
        path: File to write.
        frames: Folders of the results of the frames, in their order.
        frames_per_second: Rate of the video.

    Raises:
        InputError: If the frames differ in size, or the file cannot be written.
    """
    # The range covers every frame. One frame at a time is in memory.
    norms = [disparity_norm(*_maps(frame)) for frame in frames]
    limits = (
        min(float(norm.vmin or 0) for norm in norms),
        max(float(norm.vmax or 0) for norm in norms),
    )
    size = _maps(frames[0])[0].shape

    def pictures() -> Iterator[np.ndarray]:
        for frame in frames:
            disparity, _ = _maps(frame)
            if disparity.shape != size:
                raise InputError(
                    f"{frame}: has {list(disparity.shape)} pixels, the first frame {list(size)}; a "
                    "video needs frames of one size"
                )
            yield disparity_picture(disparity, limits=limits)

    write_video(path, pictures(), frames_per_second=frames_per_second)


def _maps(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read the disparity of a frame, NaN where its confidence is too low, and its confidence."""
    disparity, confidence = (
        np.load(folder / f"{name}.npy") for name in ("disparity", "confidence")
    )
    return np.where(confidence >= MIN_CONFIDENCE, disparity, np.nan), confidence
