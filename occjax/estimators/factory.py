"""Estimators by the name of their model and weights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from occjax.errors import InputError, check_one_of
from occjax.estimators.occcasnet import OccCasNetEstimator
from occjax.estimators.proposal import ProposalEstimator
from occjax.estimators.protocol import Estimator
from occjax.models.bundled import bundled_weights, find_weights
from occjax.models.occcasnet.config import OccCasNetConfig, Warp
from occjax.models.registry import ALIASES, ModelConfig, Precision, preset, preset_name
from occjax.models.weights import load_weights

DEFAULT_MODEL = "proposal"
"""Model of an estimator for which neither a model nor weights are named."""

TRAINING_FREE = "photometric"
"""Name of the estimator without weights."""


def make_estimator(
    model: str | None = None,
    *,
    weights: str | Path | None = None,
    warp: Warp | None = None,
    precision: str = "float32",
) -> Estimator:
    """Create an estimator from a model and weights.

    Args:
        model: ``"photometric"`` (training-free), ``"proposal"`` or a network of the paper
            (:data:`occjax.models.PRESETS`). By default the model that the weights were made for;
            without weights ``"proposal"``.
        weights: File of the weights, ``.safetensors`` or the published ``.h5`` / ``.hdf5``, or the
            name of weights in the package (``occjax weights list``). By default those of the
            model's name.
        warp: ``"correct"`` or ``"transposed"`` instead of the warp of the weights' training.
        precision: Type of the convolutions, ``"float32"`` or ``"bfloat16"``.

    Returns:
        The estimator, for :func:`occjax.estimators.run_estimator`.

    Raises:
        InputError: If model, weights and options do not fit together.

    Example:
        >>> make_estimator("photometric").name
        'photometric'
    """
    check_one_of("precision", precision, Precision)
    if model is None and weights is None:
        model = DEFAULT_MODEL
    model = model and ALIASES.get(model, model)
    chosen: Any = None if model is None else preset(model)
    if model == TRAINING_FREE:
        if weights is not None:
            raise InputError(f"the model {model} takes no weights; omit weights ({weights})")
        if warp is not None or precision != "float32":
            raise InputError(
                f"the model {model} has no warp and computes in float32; omit warp (--warp) and "
                "precision (--precision)"
            )
        return ProposalEstimator(model, chosen)
    path = _weights_path(model, weights)
    variables, config = load_weights(path, chosen, warp=warp)
    return estimator_of(config, variables, name=model, weights=path.name, precision=precision)


def estimator_of(
    config: ModelConfig,
    variables: dict,
    *,
    name: str | None = None,
    weights: str | None = None,
    precision: str = "float32",
) -> Estimator:
    """Create an estimator from a configuration and variables.

    Args:
        config: Configuration of the model.
        variables: Variables of the model.
        name: Name of the model; by default that of its preset.
        weights: Name of the weights.
        precision: Type of the convolutions, ``"float32"`` or ``"bfloat16"``.

    Returns:
        The estimator, for :func:`occjax.estimators.run_estimator`.

    Example:
        >>> estimator_of(preset("photometric"), {}).name
        'photometric'
    """
    name = name or preset_name(config)
    if isinstance(config, OccCasNetConfig):
        return OccCasNetEstimator(name, config, variables, weights, precision)
    return ProposalEstimator(name, config, variables, weights, precision)


def _weights_path(model: str | None, weights: str | Path | None) -> Path:
    """Return the file of the weights that a user names, or of those in the package."""
    if weights is not None:
        return find_weights(weights)
    for bundled in bundled_weights():
        if model == bundled.name:
            bundled.verify()
            return bundled.path
    if model == "occcasnet":
        source = "download the published weights with 'occjax weights fetch'"
    else:
        source = f"train it with 'occjax train RUN --network-preset {model}'"
    raise InputError(f"the model {model} needs weights; pass a file (--weights FILE), or {source}")
