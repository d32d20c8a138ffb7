"""Weights on disk: safetensors with the model's configuration, or the published HDF5."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
from safetensors import safe_open
from safetensors.numpy import save

from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.files import decoder_errors, decoding
from occjax.io.run_folder import first_difference
from occjax.models.bundled import is_intact
from occjax.models.config_json import config_from_json, config_to_json, convert_legacy_names
from occjax.models.occcasnet.config import OccCasNetConfig, Warp
from occjax.models.proposal.config import ProposalNetConfig
from occjax.models.registry import ModelConfig, preset, variable_shapes, without_residual

HDF5_SUFFIXES = (".h5", ".hdf5")


def save_weights(
    path: str | Path, variables: dict, config: ModelConfig, metadata: dict[str, str] | None = None
) -> None:
    """Write variables and their configuration to one safetensors file.

    Args:
        path: File to write, ending in ``.safetensors``.
        variables: Variables of the model.
        config: Configuration of the model.
        metadata: Further strings to store, for instance the training data.

    Raises:
        InputError: If the variables do not fit the configuration, the file has another suffix
            or cannot be written.

    Example:
        >>> import tempfile, jax
        >>> path = Path(tempfile.mkdtemp()) / "weights.safetensors"
        >>> config = preset("tiny")
        >>> zeros = jax.tree.map(lambda leaf: np.zeros(leaf.shape), variable_shapes(config))
        >>> save_weights(path, zeros, config)
        >>> load_weights(path)[1] == config
        True
    """
    path = Path(path)
    if path.suffix != ".safetensors":
        raise InputError(f"{path}: weights are written to .safetensors; rename the file")
    tensors = {name: np.asarray(value, order="C") for name, value in _flattened(variables).items()}
    _check_fit(path, tensors, variable_shapes(config))
    description = {**(metadata or {}), "config": config_to_json(config)}
    with atomic_path(path) as temporary:
        # Written by Python: unlike those of safetensors, its errors say which file and why.
        temporary.write_bytes(save(tensors, metadata=description))


def load_weights(
    path: str | Path, config: ModelConfig | None = None, *, warp: Warp | None = None
) -> tuple[dict, ModelConfig]:
    """Read weights and the configuration of their model.

    Args:
        path: ``.safetensors`` written by :func:`save_weights` (also by earlier versions), or
            ``.h5`` / ``.hdf5`` in the published format.
        config: Model that the weights must fit; its warp and feature statistics may differ, and
            weights of a ProposalNet may have no residual. By default the model that the file names,
            for the published format ``occcasnet``.
        warp: Warp to use instead of that of the training, which is ``"transposed"`` for the
            published format; see :class:`OccCasNetConfig`.

    Returns:
        ``variables`` and the configuration.

    Raises:
        InputError: If the file cannot be read or was made for another model.

    Example:
        >>> from occjax.models.bundled import find_weights
        >>> variables, config = load_weights(find_weights("proposal"))
        >>> config.selector.width
        32
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix in HDF5_SUFFIXES:
        published = preset("occcasnet") if config is None else config
        if not isinstance(published, OccCasNetConfig):
            raise InputError(f"{path}: the published format is for weights of OccCasNet only")
        published = dataclasses.replace(published, warp=warp or "transposed")
        from occjax.models.occcasnet.keras_weights import load_published_weights

        return load_published_weights(path, published), published
    if suffix != ".safetensors":
        raise InputError(
            f"{path}: not a file of weights; pass .safetensors, or .h5 or .hdf5 for the published "
            "format"
        )
    variables, stored = _load_safetensors(path)
    if config is not None:
        if isinstance(stored, ProposalNetConfig) and stored.residual is None:
            config = without_residual(config)
        difference = first_difference(_compared_fields(config), _compared_fields(stored))
        if difference is not None:
            raise InputError(f"{path}: was made for another model: {difference}")
    if warp is None:
        return variables, stored
    if not isinstance(stored, OccCasNetConfig):
        raise InputError(f"the model of {path.name} has no warp option; omit warp (--warp)")
    return variables, dataclasses.replace(stored, warp=warp)


def _compared_fields(config: ModelConfig) -> dict:
    """Return the fields that must agree for weights to fit a model."""
    if isinstance(config, OccCasNetConfig):
        config = dataclasses.replace(config, warp="correct", feature_statistics="pooled")
    return json.loads(config_to_json(config))


def _load_safetensors(path: Path) -> tuple[dict, ModelConfig]:
    """Read variables and configuration; check them unless the file is that of the package."""
    with decoding(path, "a safetensors file"), safe_open(path, framework="numpy") as file:
        metadata = file.metadata() or {}
        flat = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    remedy = "pass a file that occjax wrote"
    with decoder_errors(path, "the configuration of a model of this version", remedy=remedy):
        config = config_from_json(metadata["config"])
    flat = convert_legacy_names(flat)
    if not is_intact(path):  # the check takes a second
        if isinstance(config, OccCasNetConfig) and config.depth > len(flat):
            raise InputError(f"{path}: has fewer arrays than its model has layers; {remedy}")
        with decoder_errors(path, "weights of a model that can be built", remedy=remedy):
            expected = variable_shapes(config)
        _check_fit(path, flat, expected)
    return _nested(jax.device_put(flat)), config


def _flattened(tree: Mapping[str, Any]) -> dict[str, Any]:
    """Return the leaves of nested dictionaries by their paths, such as ``params/conv/kernel``.

    ``flax.traverse_util`` does the same, but compiled programs run without importing Flax.
    """
    leaves = jax.tree_util.tree_leaves_with_path(tree)
    return {jax.tree_util.keystr(path, simple=True, separator="/"): leaf for path, leaf in leaves}


def _nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested dictionaries of leaves that are given by their paths."""
    tree: dict[str, Any] = {}
    for path, value in flat.items():
        *parents, name = path.split("/")
        node = tree
        for parent in parents:
            node = node.setdefault(parent, {})
        node[name] = value
    return tree


def _check_fit(path: Path, flat: Mapping[str, Any], shapes: Mapping[str, Any]) -> None:
    """Raise an error if a weight is missing, unknown, of another shape or type, or not finite."""
    expected = _flattened(shapes)
    for name in (*expected, *flat):
        if name not in flat:
            raise InputError(f"{path}: has no weight {name}")
        if name not in expected:
            raise InputError(f"{path}: the model has no weight {name}")
        if flat[name].shape != expected[name].shape:
            raise InputError(
                f"{path}: {name} has shape {list(flat[name].shape)}, the model needs "
                f"{list(expected[name].shape)}"
            )
        if not np.issubdtype(flat[name].dtype, np.floating):
            raise InputError(f"{path}: {name} has values of the type {flat[name].dtype}")
        if not np.isfinite(flat[name]).all():
            raise InputError(f"{path}: {name} has values that are not finite")
