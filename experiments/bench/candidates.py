"""Candidates of the benchmark, each with the reference that its answer must agree with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from experiments.bench import matrix_product
from experiments.flops import count_flops
from occjax.errors import InputError
from occjax.estimators.factory import Precision
from occjax.models import OccCasNetConfig

Device = Literal["cpu", "gpu"]

PRODUCT = "matrix product"
PEERS = ("torch", "torch compiled", "tensorflow", "tensorflow eager")
LEARNING_RATE = 1e-3
"""Learning rate of the published training."""

FINEST_THRESHOLD = 0.01
"""Error above which a pixel is bad, the strictest threshold of the HCI benchmark."""

Comparison = Callable[[np.ndarray, np.ndarray], Mapping[str, float]]
"""Function that returns the differences of two answers by the name of the measure."""


FLOAT32_BOUNDS = {"median difference": 1e-5, "largest difference": 1e-4}
"""Bounds of disparity differences caused by float32 rounding, pixels per view step."""

LOW_PRECISION_BOUNDS = {"median difference": 0.05}
"""Bounds of disparity differences caused by a lower precision, pixels per view step."""


@dataclass(frozen=True)
class Candidate:
    """Program to time.

    Attributes:
        name: Name in the table.
        module: Module in :mod:`experiments.bench` that builds the program.
        function: Function that builds the program.
        options: Keyword arguments of the function.
        flops: Operations of a run as published, independent of the implementation; None if unknown.
        peer: Whether the program needs another framework.
        reference: Name of the candidate whose answer the program must agree with.
        bounds: Maximum differences from the reference, by measure.
    """

    name: str
    module: str
    function: str
    options: Mapping[str, Any] = field(default_factory=dict)
    flops: float | None = None
    peer: bool = False
    reference: str | None = None
    bounds: Mapping[str, float] = field(default_factory=dict)


def compare_disparities(answer: np.ndarray, reference: np.ndarray) -> Mapping[str, float]:
    """Return differences of ``[h, w]`` disparities, in pixels per view step."""
    difference = np.abs(answer - reference)
    return {
        "median difference": float(np.median(difference)),
        "largest difference": float(difference.max()),
        f"above {FINEST_THRESHOLD}, %": 100 * float(np.mean(difference > FINEST_THRESHOLD)),
    }


def compare_steps(answer: np.ndarray, reference: np.ndarray) -> Mapping[str, float]:
    """Return relative differences of ``[2]`` loss and gradient norm."""
    loss, norm = np.abs(answer - reference) / np.abs(reference)
    return {"gradient norm difference": float(norm), "loss difference": float(loss)}


def matrix_product_candidate(
    device: Device, precision: Precision, side: int | None = None
) -> Candidate:
    """Return the matrix product whose speed is the upper limit of a network's speed.

    Args:
        device: Device of all candidates.
        precision: Number type of the matrices.
        side: Rows and columns of the matrices; by default 4096, on a GPU 8192.
    """
    side = side or (8192 if device == "gpu" else 4096)
    options = {"side": side, "precision": precision}
    return Candidate(PRODUCT, "matrix_product", "build", options, matrix_product.flops(side))


def inference_candidates(
    config: OccCasNetConfig, size: int, device: Device, precision: Precision, peers: Sequence[str]
) -> tuple[Candidate, ...]:
    """Return the reference, the peers and occjax.

    In float32 the reference is the network with materialised volumes. In bfloat16 it is occjax in
    float32, whose memory does not grow with the image, and the proposal network takes part in both
    precisions.

    Args:
        config: The network.
        size: Height and width of the views, in pixels.
        device: Device of all candidates.
        precision: Number type of convolutions.
        peers: Some of :data:`PEERS`.

    Raises:
        InputError: If a peer does not support the precision.
    """
    flops = count_flops(config, (size, size))
    if precision == "float32":
        written = Candidate("materialised", "ours", "build_materialised", flops=flops)
        against = {"flops": flops, "reference": written.name, "bounds": FLOAT32_BOUNDS}
        ours = Candidate("occjax", "ours", "build", **against)
        others = _peers("build", peers, device, precision, against)
        return (written, *others, ours)
    options = {"precision": precision}
    full = Candidate("occjax float32", "ours", "build", flops=flops)
    against = {"flops": flops, "reference": full.name, "bounds": LOW_PRECISION_BOUNDS}
    proposal = Candidate("proposal float32", "ours", "build_proposal")
    return (
        full,
        *_peers("build", peers, device, precision, against),
        Candidate("occjax", "ours", "build", options, **against),
        proposal,
        Candidate(
            "proposal",
            "ours",
            "build_proposal",
            options,
            reference=proposal.name,
            bounds=LOW_PRECISION_BOUNDS,
        ),
    )


def training_candidates(
    config: OccCasNetConfig,
    size: int,
    batch: int,
    device: Device,
    precision: Precision,
    peers: Sequence[str],
) -> tuple[Candidate, ...]:
    """Return occjax and the peers, each with a step of Adam.

    A step counts three times the operations of inference, because the backward pass has two
    products for each product of the forward pass.

    Args:
        config: The network.
        size: Height and width of the patches, in pixels.
        batch: Number of patches.
        device: Device of all candidates.
        precision: Number type of convolutions.
        peers: Some of :data:`PEERS`.

    Raises:
        InputError: If a peer does not support the precision.
    """
    flops = 3 * batch * count_flops(config, (size, size))
    options = {"precision": precision, "rate": LEARNING_RATE}
    ours = Candidate("occjax", "ours", "train", options, flops)
    bound = 1e-2 if precision == "float32" else 0.1
    bounds = {"gradient norm difference": bound, "loss difference": bound / 10}
    against = {"flops": flops, "reference": ours.name, "bounds": bounds}
    return (
        *_peers("train", peers, device, precision, against, rate=LEARNING_RATE),
        ours,
    )


def sample_candidates(precision: Precision, side: int) -> tuple[Candidate, Candidate]:
    """Return the proposal network on the sample's centre, in float32 and in another precision."""
    full = Candidate("sample float32", "ours", "build_sample", {"side": side})
    options = {"side": side, "precision": precision}
    name = f"sample {precision}"
    against = {"reference": full.name, "bounds": {"change": 1.0}}
    return full, Candidate(name, "ours", "build_sample", options, **against)


def _peers(
    function: str,
    names: Sequence[str],
    device: Device,
    precision: Precision,
    against: Mapping[str, Any],
    **options: Any,
) -> list[Candidate]:
    found = []
    for name in names:
        framework, _, mode = name.partition(" ")
        own = {**options, "compiled": mode == "compiled" or name == "tensorflow"}
        if framework == "torch":
            own |= {"device": "cuda" if device == "gpu" else "cpu", "precision": precision}
        elif precision != "float32":
            raise InputError(f"--peers: {name} computes in float32; leave it out of {precision}")
        found.append(Candidate(name, f"peers.in_{framework}", function, own, peer=True, **against))
    return found
