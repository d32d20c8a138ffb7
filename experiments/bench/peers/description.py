"""Description of a network and its data, and its transfer between environments."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

Variables = Mapping[str, np.ndarray]
"""Values by their path in occjax without the collection: ``features/stem_0/kernel`` is
``variables["params"]["features"]["stem_0"]["kernel"]``. Kernels are ``[*taps, in, out]``."""


@dataclass(frozen=True)
class Stage:
    """Stage of the cascade.

    Attributes:
        candidates: Disparities of the first stage, residuals around the previous stage otherwise.
        occlusion: Whether occlusion maps of the previous stage weight the views.
        pairs: Number of residual blocks of the aggregation.
        width: Number of channels of the aggregation.
    """

    candidates: tuple[float, ...]
    occlusion: bool
    pairs: int
    width: int


@dataclass(frozen=True)
class Network:
    """Cascade on a square grid of views; each stage has attention and its own weights.

    Attributes:
        side: Number of views in each direction, odd.
        stem: Channels of the first two convolutions of the features.
        groups: Channels, number of blocks and dilation of each group of residual blocks.
        pooled: Window sizes of the pyramid's average pooling, in pixels.
        pooled_width: Channels of each branch of the pyramid.
        fused: Channels of the convolution over the branches.
        channels: Channels of the features.
        attention_width: Hidden units of the attention.
        stages: Stages in order.
    """

    side: int
    stem: int
    groups: tuple[tuple[int, int, int], ...]
    pooled: tuple[int, ...]
    pooled_width: int
    fused: int
    channels: int
    attention_width: int
    stages: tuple[Stage, ...]


class Problem(NamedTuple):
    """Input of every candidate.

    Attributes:
        network: The network.
        variables: Variables of the network.
        views: ``[b, v, u, h, w]`` float32 grey views in [0, 1]; one light field for inference.
        truth: ``[b, h, w]`` float32 true disparity for training, pixels per view step.
    """

    network: Network
    variables: Variables
    views: np.ndarray
    truth: np.ndarray


class Program(NamedTuple):
    """Candidate that is ready to run, with its inputs on the device.

    Attributes:
        run: Function that computes once, waits for the end, and returns the framework's array.
        fetch: Function that converts this array to a float32 NumPy array.
        peak_memory: Function that returns the peak memory of an accelerator in bytes; 0 without
            one.
    """

    run: Callable[[], Any]
    fetch: Callable[[Any], np.ndarray] = np.asarray
    peak_memory: Callable[[], int] = lambda: 0


def save(folder: Path, problem: Problem) -> None:
    """Write a problem to a folder, for :func:`load`."""
    (folder / "network.json").write_text(json.dumps(asdict(problem.network)))
    np.savez(folder / "variables.npz", **problem.variables)
    np.savez(folder / "light_fields.npz", views=problem.views, truth=problem.truth)


def load(folder: Path) -> Problem:
    """Read a problem from a folder."""
    fields = json.loads((folder / "network.json").read_text())
    stages = tuple(
        Stage(**{**stage, "candidates": tuple(stage["candidates"])}) for stage in fields["stages"]
    )
    groups = tuple(tuple(group) for group in fields["groups"])
    network = Network(
        **{**fields, "groups": groups, "pooled": tuple(fields["pooled"]), "stages": stages}
    )
    with np.load(folder / "variables.npz") as file:
        variables = dict(file)
    with np.load(folder / "light_fields.npz") as file:
        return Problem(network, variables, file["views"], file["truth"])


def octant_of_views(side: int) -> np.ndarray:
    """Return ``[side, side]`` indices of the learned attention weight of each view.

    The weights are the upper triangle of a symmetric quadrant, row by row, mirrored to all views.

    Example:
        >>> octant_of_views(3).tolist()
        [[0, 1, 0], [1, 2, 1], [0, 1, 0]]
    """
    half = side // 2 + 1
    quadrant = np.zeros((half, half), int)
    row, column = np.triu_indices(half)
    quadrant[row, column] = quadrant[column, row] = np.arange(len(row))
    return np.pad(quadrant, (0, side - half), mode="reflect")
