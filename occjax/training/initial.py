"""Variables of a model before the first step of its training."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import jax

from occjax.errors import InputError
from occjax.models import ModelConfig, ProposalNetConfig, load_weights
from occjax.models.bundled import find_weights


def initial_variables(network: ModelConfig, weights: str | Path | None) -> dict:
    """Read the initial weights of a training.

    Weights of a ProposalNet without a residual get an untrained one, which is zero everywhere.

    Args:
        network: Model to train.
        weights: A file, or a name that ``occjax weights list`` prints.

    Returns:
        Variables of the model.

    Raises:
        InputError: If the weights cannot be read or were made for another model, or for None: only
            the residual of a trained selector can be trained.

    Example:
        >>> from occjax.models import preset
        >>> sorted(initial_variables(preset("proposal"), "proposal")["params"])
        ['residual', 'selector']
    """
    if weights is None:
        raise InputError(
            "the residual is trained with a trained selector; pass its weights, for instance "
            "--initial-weights proposal"
        )
    path = find_weights(weights)
    if not isinstance(network, ProposalNetConfig) or network.residual is None:
        return load_weights(path, network)[0]
    stored = load_weights(path)[1]
    if not isinstance(stored, ProposalNetConfig) or stored.residual is not None:
        return load_weights(path, network)[0]
    from occjax.models.proposal.network import random_variables

    selection = load_weights(path, dataclasses.replace(network, residual=None))[0]
    untrained = random_variables(network, jax.random.key(0))
    return {"params": {**untrained["params"], **selection["params"]}}
