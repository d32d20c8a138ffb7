"""Conversion of networks and data between occjax and the peers."""

from __future__ import annotations

import jax
import numpy as np

from experiments.bench.peers.description import Network, Problem, Stage, Variables
from experiments.networks import SCORE_SCALE, random_light_field
from occjax.errors import InputError
from occjax.models import AggregationConfig, FeatureConfig, OccCasNetConfig, StageConfig


def describe(config: OccCasNetConfig) -> Network:
    """Return the description of a network for the peers.

    Args:
        config: A cascade whose stages have attention and their own weights, as published.

    Raises:
        InputError: If the network is another one.
    """
    stages = config.stages
    plain = (
        config.warp == "correct"
        and not config.shared_aggregation
        and all(stage.attention and stage.occlusion != "ground_truth" for stage in stages)
    )
    if not plain:
        raise InputError(
            "the peers support only stages with attention and their own weights, and no occlusion "
            "by ground truth; choose such a network, for instance occcasnet"
        )
    features = config.features
    return Network(
        side=config.views[0],
        stem=features.stem,
        groups=tuple(zip(features.widths, features.blocks, features.dilations, strict=True)),
        pooled=features.pooled,
        pooled_width=features.pooled_width,
        fused=features.fused,
        channels=features.channels,
        attention_width=config.attention_width,
        stages=tuple(
            Stage(
                stage.candidates,
                stage.occlusion != "none",
                stage.aggregation.pairs,
                stage.aggregation.width,
            )
            for stage in stages
        ),
    )


def configure(network: Network) -> OccCasNetConfig:
    """Return the configuration of a description; the inverse of :func:`describe`."""
    widths, blocks, dilations = zip(*network.groups, strict=True)
    return OccCasNetConfig(
        stages=tuple(
            StageConfig(
                stage.candidates,
                aggregation=AggregationConfig(stage.width, stage.pairs),
                occlusion="coarse" if stage.occlusion else "none",
            )
            for stage in network.stages
        ),
        views=(network.side, network.side),
        features=FeatureConfig(
            stem=network.stem,
            widths=widths,
            blocks=blocks,
            dilations=dilations,
            pooled=network.pooled,
            pooled_width=network.pooled_width,
            fused=network.fused,
            channels=network.channels,
        ),
        attention_width=network.attention_width,
    )


def flatten(variables: dict) -> Variables:
    """Return variables by path, see :data:`experiments.bench.peers.description.Variables`.

    Example:
        >>> flatten({"params": {"stem_0": {"kernel": np.ones(1)}}})
        {'stem_0/kernel': array([1.], dtype=float32)}
    """
    return {
        "/".join(part.key for part in path[1:]): np.asarray(value, np.float32)
        for path, value in jax.tree_util.tree_leaves_with_path(variables)
    }


def unflatten(flat: Variables, shapes: dict) -> dict:
    """Return variables in the structure of ``variable_shapes(config)``; inverse of `flatten`."""
    return jax.tree_util.tree_map_with_path(
        lambda path, _: flat["/".join(part.key for part in path[1:])], shapes
    )


def inference_problem(
    config: OccCasNetConfig, size: int, *, score_scale: float = SCORE_SCALE
) -> Problem:
    """Return a random light field and network; the true disparity is zero.

    Args:
        config: A cascade as :func:`describe` takes it.
        size: Height and width of the views, in pixels.
        score_scale: See :func:`experiments.networks.random_light_field`.
    """
    variables, views = random_light_field(config, size, size, score_scale=score_scale)
    truth = np.zeros((1, size, size), np.float32)
    return Problem(describe(config), flatten(variables), np.asarray(views)[None], truth)


def training_problem(config: OccCasNetConfig, size: int, batch: int) -> Problem:
    """Return random patches with random disparity, and a random network.

    The scores are not scaled, because BatchNorm in training limits all values to a few units.

    Args:
        config: A cascade as :func:`describe` takes it.
        size: Height and width of the patches, in pixels.
        batch: Number of patches.
    """
    one = inference_problem(config, size, score_scale=1.0)
    generator = np.random.default_rng(1)
    views = generator.uniform(size=(batch, *one.views.shape[1:]))
    truth = generator.uniform(-1, 1, (batch, size, size))
    return one._replace(views=views.astype(np.float32), truth=truth.astype(np.float32))
