"""Weights on disk: safetensors with the network's configuration inside, or the published HDF5."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from flax import traverse_util
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.claims import first_difference
from occjax.models.cascade import variable_shapes
from occjax.models.config import NetworkConfig, Warp
from occjax.models.description import config_from_json, config_to_json
from occjax.models.presets import preset
from occjax.models.published import load_published_weights

HDF5_SUFFIXES = (".h5", ".hdf5")


def save_weights(
    path: str | Path, variables: dict, config: NetworkConfig, metadata: dict[str, str] | None = None
) -> None:
    """Write variables and the configuration they belong to as one safetensors file.

    Args:
        path: File to write, ending in ``.safetensors``.
        variables: Collections ``params`` and ``batch_stats`` of :class:`OccCasNet`.
        config: The network's configuration.
        metadata: Further strings to keep, for instance what the weights were trained on.

    Raises:
        InputError: If the variables are not those of the configuration, or the name has another
            suffix.
    """
    path = Path(path)
    if path.suffix != ".safetensors":
        raise InputError(f"{path}: weights are written to a file that ends in .safetensors")
    tensors = {
        name: np.asarray(value, order="C")
        for name, value in traverse_util.flatten_dict(variables, sep="/").items()
    }
    _check_fit(path, tensors, config)
    description = {**(metadata or {}), "config": config_to_json(config)}
    with atomic_path(path) as temporary:
        save_file(tensors, temporary, metadata=description)


def load_weights(
    path: str | Path, config: NetworkConfig | None = None, *, warp: Warp | None = None
) -> tuple[dict, NetworkConfig]:
    """Read weights, and with which network to use them.

    Args:
        path: ``.safetensors`` written by :func:`save_weights`, or ``.h5`` / ``.hdf5`` in the
            published layout.
        config: The network they must fit, whatever its warp and feature statistics. By default the
            one the file names, for the published layout the final OccCasNet.
        warp: Which warp to use instead of the one the weights were trained with, which is
            ``"transposed"`` for the published layout; see :class:`NetworkConfig`.

    Returns:
        ``variables`` and the configuration.

    Raises:
        InputError: If the file cannot be read or was made for another network.
    """
    path = Path(path)
    if path.suffix.lower() in HDF5_SUFFIXES:
        config = dataclasses.replace(config or preset("occcasnet"), warp=warp or "transposed")
        return load_published_weights(path, config), config
    if path.suffix.lower() != ".safetensors":
        raise InputError(
            f"{path}: weights end in .safetensors, or in .h5 or .hdf5 for the published layout"
        )
    variables, stored = _load_safetensors(path)
    if config is not None:
        wanted, found = (_what_weights_mean(each) for each in (config, stored))
        difference = first_difference(wanted, found)
        if difference is not None:
            raise InputError(f"{path}: was made for another network: {difference}")
    if warp is None:
        return variables, stored
    if stored.views is None:
        raise InputError(
            f"the network of {path.name} has no choice of warp; leave out warp (--warp)"
        )
    return variables, dataclasses.replace(stored, warp=warp)


def _what_weights_mean(config: NetworkConfig) -> dict:
    """The configuration without what changes neither shape nor meaning of a weight."""
    if config.views is not None:
        config = dataclasses.replace(config, warp="correct", feature_statistics="pooled")
    return json.loads(config_to_json(config))


def _load_safetensors(path: Path) -> tuple[dict, NetworkConfig]:
    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            flat = {name: jnp.asarray(file.get_tensor(name)) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path}: is not a readable safetensors file ({error})") from error
    try:
        config = config_from_json(metadata["config"])
    except (KeyError, ValueError) as error:
        raise InputError(
            f"{path}: holds no network configuration of this version; was it written by occjax?"
        ) from error
    _check_fit(path, flat, config)
    return traverse_util.unflatten_dict(flat, sep="/"), config


def _check_fit(path: Path, flat: Mapping[str, Any], config: NetworkConfig) -> None:
    """Name the first weight that is missing, superfluous, of another shape, or not finite."""
    expected = traverse_util.flatten_dict(variable_shapes(config), sep="/")
    for name in (*expected, *flat):
        if name not in flat:
            raise InputError(f"{path}: has no weight {name}")
        if name not in expected:
            raise InputError(f"{path}: there is no place for {name}")
        if flat[name].shape != expected[name].shape:
            shapes = f"{list(flat[name].shape)}, {list(expected[name].shape)} is needed"
            raise InputError(f"{path}: {name} is {shapes}")
        if not jnp.isfinite(flat[name]).all():
            raise InputError(f"{path}: {name} is not finite")
