"""Variables of a model before the first step of its training."""

from __future__ import annotations

from pathlib import Path

import jax

from occjax.models import ModelConfig, ProposalNetConfig, load_weights
from occjax.models.bundled import find_weights
from occjax.models.proposal.network import random_variables

NO_SELECTION = (
    "the residual is that of a trained selection; pass its weights, for instance "
    "--initial-weights proposal"
)
"""Message for a training of the residual without initial weights."""


def initial_variables(network: ModelConfig, weights: str | Path) -> dict:
    """Read the initial weights of a training.

    Weights of a ProposalNet without a residual get an untrained one, which is zero everywhere.

    Args:
        network: Model to train.
        weights: A file, or a name that ``occjax weights list`` prints.

    Returns:
        Variables of the model.

    Raises:
        InputError: If the weights cannot be read or were made for another model.

    Example:
        >>> from occjax.models import preset
        >>> sorted(initial_variables(preset("proposal"), "proposal")["params"])
        ['residual', 'selector']
    """
    variables, _ = load_weights(find_weights(weights), network)
    if not isinstance(network, ProposalNetConfig) or network.residual is None:
        return variables
    if "residual" in variables["params"]:
        return variables
    untrained = random_variables(network, jax.random.key(0))
    return {"params": {**untrained["params"], **variables["params"]}}
