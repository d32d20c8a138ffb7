"""Weights on disk: safetensors with the network's configuration inside, or the published HDF5."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from flax import traverse_util
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.models.config import FeatureConfig, NetworkConfig, StageConfig, Warp, preset
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
    """
    tensors = {
        name: np.ascontiguousarray(value)
        for name, value in traverse_util.flatten_dict(variables, sep="/").items()
    }
    description = {**(metadata or {}), "config": json.dumps(dataclasses.asdict(config))}
    with atomic_path(path) as temporary:
        save_file(tensors, temporary, metadata=description)


def load_weights(
    path: str | Path, config: NetworkConfig | None = None, *, warp: Warp | None = None
) -> tuple[dict, NetworkConfig]:
    """Read weights, and with which network to use them.

    Args:
        path: ``.safetensors`` written by :func:`save_weights`, or ``.h5`` / ``.hdf5`` in the
            published layout.
        config: The network they must fit. By default the one the file names; for the published
            layout the final OccCasNet with the transposed warp it was trained with.
        warp: Which warp to use instead; see :class:`NetworkConfig`.

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
    if config is not None and dataclasses.replace(config, warp=stored.warp) != stored:
        raise InputError(
            f"{path}: was made for another network: {_first_difference(config, stored)}"
        )
    return variables, stored if warp is None else dataclasses.replace(stored, warp=warp)


def _load_safetensors(path: Path) -> tuple[dict, NetworkConfig]:
    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            flat = {name: jnp.asarray(file.get_tensor(name)) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path}: is not a readable safetensors file ({error})") from error
    if "config" not in metadata:
        raise InputError(f"{path}: names no network configuration; was it written by occjax?")
    return traverse_util.unflatten_dict(flat, sep="/"), _config_from_json(metadata["config"])


def _config_from_json(text: str) -> NetworkConfig:
    """The inverse of ``json.dumps(dataclasses.asdict(config))``."""

    def tuples(value):
        return tuple(tuples(item) for item in value) if isinstance(value, list) else value

    fields = {key: tuples(value) for key, value in json.loads(text).items()}
    fields["features"] = FeatureConfig(**{k: tuples(v) for k, v in fields["features"].items()})
    fields["stages"] = tuple(
        StageConfig(**{k: tuples(v) for k, v in stage.items()}) for stage in fields["stages"]
    )
    return NetworkConfig(**fields)


def _first_difference(wanted: NetworkConfig, stored: NetworkConfig) -> str:
    for field in dataclasses.fields(NetworkConfig):
        ours, theirs = getattr(wanted, field.name), getattr(stored, field.name)
        if ours != theirs:
            return f"{field.name} is {theirs}, not {ours}"
    raise AssertionError("the configurations are equal")
