"""occjax as a candidate: inference, and the network as it is written."""

from __future__ import annotations

from collections.abc import Callable

import jax
import numpy as np

from experiments.bench.exchange import configure, unflatten
from experiments.bench.peers.description import Network, Variables
from occjax.inference.network import infer
from occjax.models import OccCasNet, variable_shapes


def build(network: Network, variables: Variables) -> Callable[[np.ndarray], np.ndarray]:
    """Inference with these variables, as a function of the views."""
    config = configure(network)
    return _compiled(network, variables, lambda values, views: infer(values, views, config))


def build_written(network: Network, variables: Variables) -> Callable[[np.ndarray], np.ndarray]:
    """The network as the paper describes it, its volumes materialised."""
    return _compiled(network, variables, OccCasNet(configure(network)).apply)


def _compiled(network, variables, stages):
    values = jax.device_put(unflatten(variables, variable_shapes(configure(network))))
    last = jax.jit(lambda values, views: stages(values, views)[-1].disparity)
    return lambda views: np.asarray(last(values, views))
