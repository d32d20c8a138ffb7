"""Networks of occjax as the peers take them."""

from __future__ import annotations

import jax
import numpy as np

from experiments.bench.peers.description import Network, Problem, Stage, Variables
from experiments.networks import SCORES, random_light_field
from occjax.errors import InputError
from occjax.models import NetworkConfig
from occjax.models.config import FeatureConfig, Residual, StageConfig, of_kind


def describe(config: NetworkConfig) -> Network:
    """A network as the peers know it.

    Args:
        config: A cascade as published: its stages have attention and weights of their own.

    Raises:
        InputError: If it is another one.
    """
    stages = config.stages
    plain = (
        config.views is not None
        and config.warp == "correct"
        and not config.shared_aggregation
        and all(stage.attention and stage.occlusion != "ground_truth" for stage in stages)
        and all(isinstance(stage.aggregation, Residual) for stage in stages)
    )
    if not plain:
        raise InputError(
            "the peers are cascades on a grid of views, each stage with attention and weights of "
            "its own, without a ground truth; choose such a network, for instance occcasnet"
        )
    features = of_kind(config.features, FeatureConfig)
    aggregations = [of_kind(stage.aggregation, Residual) for stage in stages]
    return Network(
        side=of_kind(config.views, tuple)[0],
        stem=features.stem,
        groups=tuple(zip(features.widths, features.blocks, features.dilations, strict=True)),
        pooled=features.pooled,
        pooled_width=features.pooled_width,
        fused=features.fused,
        channels=features.channels,
        attention_width=config.attention_width,
        stages=tuple(
            Stage(stage.candidates, stage.occlusion != "none", aggregation.pairs, aggregation.width)
            for stage, aggregation in zip(stages, aggregations, strict=True)
        ),
    )


def configure(network: Network) -> NetworkConfig:
    """The inverse of :func:`describe`."""
    widths, blocks, dilations = zip(*network.groups, strict=True)
    return NetworkConfig(
        stages=tuple(
            StageConfig(
                stage.candidates,
                aggregation=Residual(stage.width, stage.pairs),
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
    """Variables by their path, as :data:`experiments.bench.peers.description.Variables` has them.

    Example:
        >>> flatten({"params": {"stem_0": {"kernel": np.ones(1)}}})
        {'stem_0/kernel': array([1.], dtype=float32)}
    """
    return {
        "/".join(part.key for part in path[1:]): np.asarray(value, np.float32)
        for path, value in jax.tree_util.tree_leaves_with_path(variables)
    }


def unflatten(flat: Variables, shapes: dict) -> dict:
    """The inverse: values by their path in the structure of ``variable_shapes(config)``."""
    return jax.tree_util.tree_map_with_path(
        lambda path, _: flat["/".join(part.key for part in path[1:])], shapes
    )


def inference_problem(config: NetworkConfig, size: int, *, scores: float = SCORES) -> Problem:
    """A random light field and network, its disparity zero.

    Args:
        config: A cascade as :func:`describe` takes it.
        size: Height and width of the views, in pixels.
        scores: As for :func:`experiments.networks.random_light_field`.
    """
    variables, views = random_light_field(config, size, size, scores=scores)
    truth = np.zeros((1, size, size), np.float32)
    return Problem(describe(config), flatten(variables), np.asarray(views)[None], truth)


def training_problem(config: NetworkConfig, size: int, batch: int) -> Problem:
    """Random patches with random disparity, and a random network.

    Its scores are not scaled: BatchNorm in training keeps all values to a few units.

    Args:
        config: A cascade as :func:`describe` takes it.
        size: Height and width of the patches, in pixels.
        batch: Their number.
    """
    one = inference_problem(config, size, scores=1.0)
    generator = np.random.default_rng(1)
    views = generator.uniform(size=(batch, *one.views.shape[1:]))
    truth = generator.uniform(-1, 1, (batch, size, size))
    return one._replace(views=views.astype(np.float32), truth=truth.astype(np.float32))
