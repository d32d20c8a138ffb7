"""Network configurations as JSON, and how two of them differ."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

from occjax.models.config import (
    Choice,
    DerivativeFeatures,
    FeatureConfig,
    NetworkConfig,
    Residual,
    SemiGlobalConfig,
    StageConfig,
)

_KINDS = {
    kind.__name__: kind
    for kind in (
        Choice,
        DerivativeFeatures,
        FeatureConfig,
        NetworkConfig,
        Residual,
        SemiGlobalConfig,
        StageConfig,
    )
}


def config_to_json(config: NetworkConfig) -> str:
    """A configuration as JSON; every part says of which kind it is.

    Example:
        >>> from occjax.models import preset
        >>> config_from_json(config_to_json(preset("light"))) == preset("light")
        True
    """

    def encoded(value: Any) -> Any:
        if dataclasses.is_dataclass(value):
            fields = {
                field.name: encoded(getattr(value, field.name))
                for field in dataclasses.fields(value)
            }
            return {"kind": type(value).__name__, **fields}
        return [encoded(item) for item in value] if isinstance(value, tuple) else value

    return json.dumps(encoded(config))


def config_from_json(text: str) -> NetworkConfig:
    """The inverse of :func:`config_to_json`.

    Args:
        text: JSON.

    Returns:
        The configuration.

    Raises:
        ValueError: If the text describes no network of this version.
    """

    def decoded(value: Any) -> Any:
        if isinstance(value, dict):
            fields = {key: decoded(item) for key, item in value.items()}
            return _KINDS[fields.pop("kind")](**fields)
        return tuple(decoded(item) for item in value) if isinstance(value, list) else value

    try:
        config = decoded(json.loads(text))
    except (KeyError, TypeError) as error:
        raise ValueError(f"no network configuration of this version: {error}") from error
    if not isinstance(config, NetworkConfig):
        raise ValueError("no network configuration")
    return config


def first_difference(wanted: Any, stored: Any) -> str | None:
    """The first field in which two configurations differ, in words.

    Args:
        wanted: A configuration, as ``dataclasses.asdict`` or JSON gives it.
        stored: Another one.

    Returns:
        For instance ``"optimiser.peak_rate is 0.001, not 0.01"`` (the stored value comes first), or
        None if they agree.

    Example:
        >>> first_difference({"loss": {"border": 2}}, {"loss": {"border": 0}})
        'loss.border is 0, not 2'
    """
    ours, theirs = dict(_leaves(wanted)), dict(_leaves(stored))
    for name in (*ours, *theirs):
        if name not in ours or name not in theirs or ours[name] != theirs[name]:
            return f"{name} is {theirs.get(name, 'absent')}, not {ours.get(name, 'absent')}"
    return None


def _leaves(value: Any, name: str = ""):
    """Values of a tree of dictionaries and sequences with their paths, ``stages[0].width``."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves(item, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list | tuple) and value and isinstance(value[0], dict):
        for index, item in enumerate(value):
            yield from _leaves(item, f"{name}[{index}]")
    else:
        yield name, list(value) if isinstance(value, tuple) else value
