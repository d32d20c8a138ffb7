"""Who takes part in the benchmark, and whose answer each must agree with before it is timed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from experiments.bench import matrix_product
from occjax.errors import InputError
from occjax.models import NetworkConfig
from occjax.models.work import count_flops
from occjax.training.config import Precision

Device = Literal["cpu", "gpu"]

PRODUCT = "matrix product"
PEERS = ("torch", "torch compiled", "tensorflow", "tensorflow eager")
RATE = 1e-3
"""Of learning, the published one."""

BAD = 0.01
"""Change of disparity above which a pixel counts, that of the strictest BadPix."""

Comparison = Callable[[np.ndarray, np.ndarray], Mapping[str, float]]
"""How far an answer is from another, by the name of the measure."""


EQUAL = {"median difference": 1e-5, "largest difference": 1e-4}
"""Bounds of disparities that differ by the rounding of float32 alone."""

ALIKE = {"median difference": 0.05}
"""Bounds of disparities in another precision."""


@dataclass(frozen=True)
class Candidate:
    """A program that is timed.

    Attributes:
        name: What the table calls it.
        module: Where it is built, in :mod:`experiments.bench`.
        function: That builds it.
        options: Keyword arguments of the function.
        flops: Operations of a run as published, whatever are done; None where nobody counts them.
        peer: Whether it needs another framework.
        reference: Name of the candidate with whose answer its own must agree.
        bounds: Of measures of the difference, by name.
    """

    name: str
    module: str
    function: str
    options: Mapping[str, Any] = field(default_factory=dict)
    flops: float | None = None
    peer: bool = False
    reference: str | None = None
    bounds: Mapping[str, float] = field(default_factory=dict)


def of_disparity(answer: np.ndarray, reference: np.ndarray) -> Mapping[str, float]:
    """How far disparities ``[h, w]`` are apart, in pixels per view step."""
    apart = np.abs(answer - reference)
    return {
        "median difference": float(np.median(apart)),
        "largest difference": float(apart.max()),
        f"above {BAD}, %": 100 * float(np.mean(apart > BAD)),
    }


def of_step(answer: np.ndarray, reference: np.ndarray) -> Mapping[str, float]:
    """How far loss and norm of the gradient ``[2]`` are apart, relative to the reference."""
    loss, norm = np.abs(answer - reference) / np.abs(reference)
    return {"gradient norm apart": float(norm), "loss apart": float(loss)}


def product(device: Device, precision: Precision) -> Candidate:
    """The matrix product that a network's speed is measured against."""
    side = 8192 if device == "gpu" else 4096
    options = {"side": side, "precision": precision}
    return Candidate(PRODUCT, "matrix_product", "build", options, matrix_product.flops(side))


def for_inference(
    config: NetworkConfig, size: int, device: Device, precision: Precision, peers: Sequence[str]
) -> tuple[Candidate, ...]:
    """The matrix product, the reference, the peers and occjax.

    In float32 the reference is the network as it is written; in bfloat16 it is the inference of
    occjax in float32, whose memory does not grow with the image, and the light network takes part
    in both.

    Args:
        config: The network.
        size: Height and width of the views, in pixels.
        device: Where it runs.
        precision: Of the convolutions.
        peers: Some of :data:`PEERS`.

    Raises:
        InputError: If a peer does not compute in this precision.
    """
    flops = count_flops(config, (size, size))
    if precision == "float32":
        written = Candidate("written", "ours", "build_written", flops=flops)
        against = {"flops": flops, "reference": written.name, "bounds": EQUAL}
        ours = Candidate("occjax", "ours", "build", **against)
        others = _peers("build", peers, device, precision, against)
        return (product(device, precision), written, *others, ours)
    options = {"precision": precision}
    full = Candidate("occjax float32", "ours", "build", flops=flops)
    against = {"flops": flops, "reference": full.name, "bounds": ALIKE}
    light = Candidate("light float32", "ours", "build_light")
    return (
        product(device, precision),
        full,
        *_peers("build", peers, device, precision, against),
        Candidate("occjax", "ours", "build", options, **against),
        light,
        Candidate("light", "ours", "build_light", options, reference=light.name, bounds=ALIKE),
    )


def for_training(
    config: NetworkConfig,
    size: int,
    batch: int,
    device: Device,
    precision: Precision,
    peers: Sequence[str],
) -> tuple[Candidate, ...]:
    """The matrix product, occjax and the peers, each with a step of Adam.

    A step counts as three times the operations of inference: the backward pass has two products
    for each of the forward pass.

    Args:
        config: The network.
        size: Height and width of the patches, in pixels.
        batch: Their number.
        device: Where it runs.
        precision: Of the convolutions.
        peers: Some of :data:`PEERS`.

    Raises:
        InputError: If a peer does not compute in this precision.
    """
    flops = 3 * batch * count_flops(config, (size, size))
    options = {"precision": precision, "rate": RATE}
    ours = Candidate("occjax", "ours", "train", options, flops)
    bound = 1e-2 if precision == "float32" else 0.1
    bounds = {"gradient norm apart": bound, "loss apart": bound / 10}
    against = {"flops": flops, "reference": ours.name, "bounds": bounds}
    return (
        product(device, precision),
        *_peers("train", peers, device, precision, against, rate=RATE),
        ours,
    )


def of_sample(precision: Precision, side: int) -> tuple[Candidate, Candidate]:
    """The light network on the middle of the bundled sample, in float32 and in a precision."""
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
