"""Openly licensed photographs, as textures for random light fields.

They are those that the wheel of scikit-image contains, read from where it is installed; nothing is
downloaded and nothing is copied into this package. Their licences, as scikit-image states them:

=====================  =================================================================
astronaut              NASA; public domain
brick, grass, gravel   CC0 (CC0Textures; linolafett on DeviantArt; CC0Textures)
camera                 CC0, Lav Varshney
chelsea                CC0, Stefan van der Walt
coffee                 CC0, Rachel Michetti
coins                  Brooklyn Museum; no known copyright restrictions
hubble_deep_field      NASA; public domain
retina                 CC0, Mikael Häggström
rocket                 SpaceX; public domain
=====================  =================================================================
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

import imageio.v3 as imageio
import numpy as np

from occjax.errors import InputError
from occjax.lightfield import to_grey

SIZE = 256
"""Rows and columns of each photograph."""

FILES = (
    "astronaut.png",
    "brick.png",
    "camera.png",
    "chelsea.png",
    "coffee.png",
    "coins.png",
    "grass.png",
    "gravel.png",
    "hubble_deep_field.jpg",
    "retina.jpg",
    "rocket.jpg",
)


def load_photographs() -> np.ndarray:
    """Square pieces of the photographs, at full, half and quarter resolution.

    Returns:
        ``[p, 256, 256]`` float32 grey in [0, 1].

    Raises:
        InputError: If scikit-image is not installed or lacks a file.
    """
    package = importlib.util.find_spec("skimage")
    if package is None or package.origin is None:
        raise InputError("photographs: scikit-image is missing; pip install scikit-image")
    pieces: list[np.ndarray] = []
    for name in FILES:
        path = Path(package.origin).parent / "data" / name
        if not path.is_file():
            raise InputError(f"{path}: not there; reinstall scikit-image")
        image = np.asarray(imageio.imread(path))
        grey = to_grey(image[..., :3] if image.ndim == 3 else image[..., None])
        while min(grey.shape) >= SIZE:
            pieces.extend(_tiles(grey))
            grey = _halved(grey)
    return np.stack(pieces)


def _tiles(image: np.ndarray) -> list[np.ndarray]:
    """At most 2x2 pieces, beside and below each other, from the middle of an image."""
    rows, columns = (min(2, size // SIZE) for size in image.shape)
    top, left = (image.shape[0] - rows * SIZE) // 2, (image.shape[1] - columns * SIZE) // 2
    return [
        image[top + i * SIZE :, left + j * SIZE :][:SIZE, :SIZE]
        for i in range(rows)
        for j in range(columns)
    ]


def _halved(image: np.ndarray) -> np.ndarray:
    """Mean of every 2x2 pixels."""
    h, w = image.shape[0] // 2, image.shape[1] // 2
    return image[: 2 * h, : 2 * w].reshape(h, 2, w, 2).mean(axis=(1, 3), dtype=np.float32)
