"""Network configurations as JSON."""

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
