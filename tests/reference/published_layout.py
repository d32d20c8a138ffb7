"""Weights in the layout of the published file: Keras 2, HDF5.

Arrays are held in a dictionary from their path in the group ``model_weights`` to the array, in the
order of the file, e.g. ``model/conv2d_7/kernel:0`` or ``conv3d_2/conv3d_2/kernel:0``: the layer of
the outer network, then the weight's own name.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import h5py
import numpy as np

from tests.reference.network import BLOCKS, POOLING, SHORTCUT

WIDTHS = (4, 8, 16, 16)
"""Channels of each group of residual blocks, as published."""
FEATURES = 4
"""Channels of each branch of the pyramid and of the features of a view, as published."""


def published_shapes(
    *, grid: int = 9, attention: int = 120, aggregation: int = 96
) -> dict[str, tuple[int, ...]]:
    """Names and shapes of all weights of a two-stage network, in the order of the file.

    Args:
        grid: Views in a row and in a column of the light field.
        attention: Hidden width of the attention over views.
        aggregation: Channels of the 3-D convolutions.
    """
    channels = grid**2 * FEATURES
    half = (grid + 1) // 2
    shapes = {f"model/{name}": shape for name, shape in _feature_shapes()}
    conv3d, normalization = itertools.count(), itertools.count(len(_feature_convolutions()))

    def layer(kind: str, numbers: Iterator[int], weights: Mapping[str, tuple[int, ...]]) -> None:
        name = _numbered(kind, next(numbers))
        shapes.update({f"{name}/{name}/{weight}:0": shape for weight, shape in weights.items()})

    for _ in range(2):
        for width, out in ((channels, attention), (attention, half * (half + 1) // 2)):
            layer("conv3d", conv3d, {"kernel": (1, 1, 1, width, out), "bias": (out,)})
        for width in (channels, *[aggregation] * 6):
            layer("conv3d", conv3d, {"kernel": (3, 3, 3, width, aggregation)})
            weights = ("gamma", "beta", "moving_mean", "moving_variance")
            layer("batch_normalization", normalization, dict.fromkeys(weights, (aggregation,)))
        layer("conv3d", conv3d, {"kernel": (3, 3, 3, aggregation, 1)})
    return shapes


def write_published_layout(
    path: Path | str, weights: Mapping[str, np.ndarray], *, first_number: int = 0
) -> None:
    """Write a file as Keras 2 does.

    Args:
        path: HDF5 file to write.
        weights: Arrays by path, in the order of :func:`published_shapes`.
        first_number: Added to the number in every layer's name: Keras goes on counting when a
            program builds a second network, so the start of the numbers means nothing.
    """
    layers: dict[str, dict[str, np.ndarray]] = {}
    for path_in_file, array in weights.items():
        layer, name = _renumbered(path_in_file, first_number).split("/", 1)
        layers.setdefault(layer, {})[name] = np.asarray(array, np.float32)
    with h5py.File(path, "w") as file:
        file.attrs["backend"] = np.bytes_("tensorflow")
        file.attrs["keras_version"] = np.bytes_("2.5.0")
        file.create_group("optimizer_weights").attrs["weight_names"] = np.array([])
        root = file.create_group("model_weights")
        root.attrs["backend"] = np.bytes_("tensorflow")
        root.attrs["keras_version"] = np.bytes_("2.5.0")
        names = list(_with_layers_without_weights(layers))
        root.attrs["layer_names"] = np.array(names, "S")
        for layer in names:
            group = root.create_group(layer)
            own = layers.get(layer, {})
            group.attrs["weight_names"] = np.array(list(own), "S") if own else np.array([])
            for name, array in own.items():
                group[name] = array


def read_published_layout(path: Path | str) -> dict[str, np.ndarray]:
    """Read a file in that layout back into arrays by path, in the order of the file."""

    def text(name: bytes | str) -> str:
        return name.decode() if isinstance(name, bytes) else name

    weights = {}
    with h5py.File(path) as file:
        root = file["model_weights"]
        for layer in map(text, root.attrs["layer_names"]):
            for name in map(text, root[layer].attrs["weight_names"]):
                weights[f"{layer}/{name}"] = root[layer][name][()]
    return weights


def _feature_shapes() -> Iterator[tuple[str, tuple[int, ...]]]:
    """The nested feature network: trainable weights first, statistics after."""
    shapes = _feature_convolutions()
    rows = _feature_rows(len(shapes))
    for row in rows:
        for number in row:
            yield f"{_numbered('conv2d', number)}/kernel:0", shapes[number]
        for number, weight in itertools.product(row, ("gamma", "beta")):
            yield f"{_numbered('batch_normalization', number)}/{weight}:0", shapes[number][-1:]
    yield f"conv2d_{len(shapes)}/kernel:0", (1, 1, shapes[-1][-1], FEATURES)
    for number in itertools.chain(*rows):
        for weight in ("moving_mean", "moving_variance"):
            yield f"{_numbered('batch_normalization', number)}/{weight}:0", shapes[number][-1:]


def _feature_convolutions() -> list[tuple[int, int, int, int]]:
    """Kernel shapes of the 2-D convolutions that a BatchNorm follows, in creation order."""
    shapes = [(3, 3, 1, WIDTHS[0]), (3, 3, WIDTHS[0], WIDTHS[0])]
    before = WIDTHS[0]
    for width, blocks, shortcut in zip(WIDTHS, BLOCKS, SHORTCUT, strict=True):
        if shortcut:
            shapes.append((1, 1, before, width))
        shapes.append((3, 3, before, width))
        shapes += [(3, 3, width, width)] * (2 * blocks - 1)
        before = width
    shapes += [(1, 1, before, FEATURES)] * len(POOLING)
    concatenated = WIDTHS[1] + WIDTHS[3] + FEATURES * len(POOLING)
    return [*shapes, (3, 3, concatenated, WIDTHS[3])]


def _feature_rows(count: int) -> list[list[int]]:
    """Creation numbers in the order of the file.

    Keras lists layers by their depth in the graph: a shortcut comes with the second convolution of
    its block, the branches of the pyramid come together and backwards.
    """
    rows, number = [[0], [1]], 2
    for blocks, shortcut in zip(BLOCKS, SHORTCUT, strict=True):
        if shortcut:
            rows += [[number + 1], [number + 2, number]]
            number, blocks = number + 3, blocks - 1
        rows += [[number + i] for i in range(2 * blocks)]
        number += 2 * blocks
    branches = range(number, number + len(POOLING))
    rows += [[*reversed(branches)], [branches.stop]]
    assert branches.stop + 1 == count
    return rows


def _with_layers_without_weights(layers: Mapping[str, object]) -> Iterator[str]:
    """Layer names as in a real file, which also lists the layers that hold nothing."""
    yield from (f"input_{number}" for number in range(1, 4))
    for number, layer in enumerate(layers, start=1):
        yield layer
        yield f"activation_{number}"
    yield "tf.__operators__.add"


def _numbered(kind: str, number: int) -> str:
    return f"{kind}_{number}" if number else kind


def _renumbered(path: str, first_number: int) -> str:
    """Add to the number of every layer in ``path``; none counts as zero."""

    def replace(match: re.Match) -> str:
        return _numbered(match[1], int(match[2] or 0) + first_number)

    *layers, weight = path.split("/")
    return "/".join([*(re.sub(r"^(.+?)(?:_(\d+))?$", replace, name) for name in layers), weight])
