"""Batches of textured planes of known disparity, and networks that compile fast."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax.data.samples import LightFieldSample
from occjax.lightfield import view_offsets
from occjax.models import AggregationConfig, FeatureConfig, OccCasNetConfig, StageConfig, preset
from occjax.models.proposal import SelectorConfig
from occjax.training import OptimiserConfig, TrainConfig
from occjax.training.prepared import DISPARITY_STEPS, PackedProposals, PreparedSample
from tests.scenes import plane

_STAGE = {"aggregation": AggregationConfig(width=4, pairs=0), "attention": False}
NETWORK = OccCasNetConfig(
    stages=(
        StageConfig((-1.5, -0.5, 0.5, 1.5), **_STAGE),
        StageConfig((-0.5, 0.0, 0.5), occlusion="coarse", **_STAGE),
    ),
    views=(3, 3),
    features=FeatureConfig(
        widths=(4, 4), blocks=(1, 1), dilations=(1, 1), pooled=(2,), pooled_width=2, fused=4
    ),
)
"""A first stage, and one with residuals and occlusion weights, in as few layers as possible.

These tests spend most of their time compiling.
"""

PROPOSAL_NETWORK = preset("proposal_small", selector=SelectorConfig(8, (8,)))


def planes(step, count=2, size=(12, 14)):
    """Return a batch of planes; the step is the random seed."""
    generator = np.random.default_rng(step)
    fields = [
        plane(size=size, disparity=generator.uniform(-1.2, 1.2), seed=generator.integers(10**6))
        for _ in range(count)
    ]
    return LightFieldSample(
        views=jnp.stack([field.grey() for field in fields]),
        offsets=jnp.stack([view_offsets(3, 3)] * count),
        disparity=jnp.stack([field.ground_truth for field in fields]),
        visibility=jnp.ones((count, 3, 3, *size), bool),
        valid=jnp.ones((count, *size), bool),
    )


def prepared_batch(count=2, size=(16, 16), seed=4):
    """Return ten random proposals for each pixel; number 3 is correct and has low costs.

    Costs are stored as 255 times their square root.
    """
    generator = np.random.default_rng(seed)
    truth = generator.uniform(-1.0, 1.0, (count, *size)).astype(np.float32)
    proposed = truth[:, None] + generator.choice([-0.4, 0.3], (count, 10, *size))
    proposed[:, 3] = truth
    costs = np.full((count, 10, 13, *size), 200, np.uint8)
    costs[:, 3] = 20
    packed = PackedProposals(
        centre=np.full(truth.shape, 100, np.uint8),
        disparity=proposed[:, 0].astype(np.float32),
        proposed=np.rint(DISPARITY_STEPS * proposed).astype(np.int16),
        costs=costs,
        log_variance=np.zeros(truth.shape, np.float16),
        peak_probability=np.ones(truth.shape, np.float16),
    )
    return jax.tree.map(jnp.asarray, PreparedSample(packed, truth, np.ones(truth.shape, bool)))


@pytest.fixture(scope="session")
def source():
    """Source of batches of two textured planes."""
    return planes


@pytest.fixture(scope="session")
def six_steps():
    """Settings of a training of six steps."""
    optimiser = OptimiserConfig(peak_rate=3e-3, warm_up=2, clip=1.0)
    return TrainConfig(NETWORK, optimiser=optimiser, steps=6)
