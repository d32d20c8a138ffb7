"""Makes ``fixture.npz``: a small network's weights, an input, and the reference's answers.

    python -m tests.reference.make_fixture

With it the agreement of the Flax network with the independent one is tested where the published
activations are absent. The network has the published structure with 8 channels instead of 96 in
the 3-D convolutions. The keys of the file:

* ``weights/PATH``: the weights, by path in the published file and in its order. Their values are
  exact in float16, which keeps the file small;
* ``light_field [V, U, H, W]``, ``coarse_candidates [D]``, ``refined_candidates [D']``;
* ``correct/NAME`` and ``transposed/NAME``: the answers of both warps, under the names (and, for
  the volumes, at the sampling) of the published activations.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.reference.network import Weights, coarse_stage, refined_stage
from tests.reference.published_layout import published_shapes

FIXTURE = Path(__file__).with_name("fixture.npz")
COARSE_CANDIDATES = np.linspace(-2.5, 2.5, 9)
REFINED_CANDIDATES = np.linspace(-0.5, 0.5, 5)
IMAGE_SIZE = (13, 15)

LIMITS = {
    "feature_center": 1e-4,
    "attention_coarse": 1e-4,
    "attention_refined": 1e-4,
    "occlusion_weight": 1e-4,
    "coarse_volume_sample": 1e-4,
    "refined_volume_sample": 5e-3,
    "coarse_prob": 1e-3,
    "refined_prob": 1e-3,
    "disparity_coarse": 1e-3,
    "disparity_refined": 1e-3,
}
"""Largest difference allowed from activations that were computed in float32.

The refined volume is looser, since a coarse disparity that differs in its last bits moves the taps
of features as large as ten.
"""


def load_fixture(path: Path = FIXTURE) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The weights by path in the published file, and everything else by key."""
    with np.load(path) as archive:
        arrays = dict(archive)
    prefix = "weights/"
    weights = {
        key.removeprefix(prefix): array.astype(np.float32)
        for key, array in arrays.items()
        if key.startswith(prefix)
    }
    return weights, {key: a for key, a in arrays.items() if not key.startswith(prefix)}


def answers(
    weights: Weights,
    light_field: np.ndarray,
    coarse_candidates: np.ndarray,
    refined_candidates: np.ndarray,
) -> dict[str, dict[str, np.ndarray]]:
    """What the published activations hold, for ``"correct"`` and ``"transposed"`` warp."""
    first = coarse_stage(weights, light_field, coarse_candidates)
    result = {}
    for warp in ("correct", "transposed"):
        second = refined_stage(
            weights, light_field, first, refined_candidates, transposed=warp == "transposed"
        )
        found = first | second
        found["coarse_volume_sample"] = found.pop("coarse_volume")[::8, ::7, ::5]
        found["refined_volume_sample"] = found.pop("refined_volume")[::2, ::7, ::5]
        del found["features"]
        result[warp] = found
    return result


def random_weights(generator: np.random.Generator) -> dict[str, np.ndarray]:
    """Weights that keep activations near one through the residual blocks, and no BatchNorm idle."""
    weights = {}
    for path, shape in published_shapes(aggregation=8).items():
        name = path.split("/")[-1]
        if name == "kernel:0":
            array = generator.normal(0.0, np.sqrt(1.5 / np.prod(shape[:-1])), shape)
        elif name == "gamma:0":
            array = generator.uniform(0.4, 1.0, shape)
        elif name == "moving_variance:0":
            array = generator.uniform(0.5, 1.5, shape)
        else:
            array = generator.normal(0.0, 0.3, shape)
        if shape[-1] == 1:  # the cost: decided enough for the disparities to spread
            array *= 4.0
        weights[path] = array.astype(np.float16)
    return weights


def random_light_field(generator: np.random.Generator, disparity: float = 0.6) -> np.ndarray:
    """``[9, 9, H, W]``: a smooth texture of one disparity, and noise that no disparity explains."""
    v, u, y, x = np.mgrid[-4:5, -4:5, : IMAGE_SIZE[0], : IMAGE_SIZE[1]].astype(float)
    row, column = y + disparity * v, x + disparity * u
    texture = np.zeros(row.shape)
    for _ in range(12):
        frequency = generator.uniform(-1.2, 1.2, 2)
        texture += np.cos(frequency[0] * row + frequency[1] * column + generator.uniform(0, 6.28))
    texture = 0.5 + 0.15 * texture + generator.normal(0.0, 0.05, texture.shape)
    return np.clip(texture, 0.0, 1.0).astype(np.float32)


def main() -> None:
    generator = np.random.default_rng(20230528)
    weights = random_weights(generator)
    light_field = random_light_field(generator)
    found = answers(Weights.from_names(weights), light_field, COARSE_CANDIDATES, REFINED_CANDIDATES)
    arrays = {f"weights/{path}": array for path, array in weights.items()}
    arrays |= {
        "light_field": light_field,
        "coarse_candidates": COARSE_CANDIDATES,
        "refined_candidates": REFINED_CANDIDATES,
    }
    for warp, named in found.items():
        arrays |= {f"{warp}/{name}": array.astype(np.float32) for name, array in named.items()}
    np.savez_compressed(FIXTURE, **arrays)
    print(f"{FIXTURE.name}: {FIXTURE.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
