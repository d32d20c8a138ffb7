"""Model configurations as JSON, and the conversion of files of earlier versions."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable, Mapping
from typing import Any, get_type_hints

from typeguard import CollectionCheckStrategy, TypeCheckError, check_type

from occjax.models.occcasnet import config as occcasnet_config
from occjax.models.proposal import config as proposal_config
from occjax.models.registry import ModelConfig

_KINDS: dict[str, Callable[..., Any]] = {
    kind.__name__: kind
    for module in (occcasnet_config, proposal_config)
    for kind in vars(module).values()
    if dataclasses.is_dataclass(kind) and isinstance(kind, type)
}


def config_to_json(config: ModelConfig) -> str:
    """Encode a configuration as JSON; every dataclass names its kind.

    Example:
        >>> from occjax.models import preset
        >>> config_from_json(config_to_json(preset("proposal"))) == preset("proposal")
        True
    """

    def encode(value: Any) -> Any:
        if dataclasses.is_dataclass(value):
            fields = {
                field.name: encode(getattr(value, field.name))
                for field in dataclasses.fields(value)
            }
            return {"kind": type(value).__name__, **fields}
        return [encode(item) for item in value] if isinstance(value, tuple) else value

    return json.dumps(encode(config))


def config_from_json(text: str) -> ModelConfig:
    """Decode the JSON of :func:`config_to_json`, also of earlier versions.

    Raises:
        ValueError: If the text does not describe a model of this version.
    """

    def decode(value: Any) -> Any:
        if isinstance(value, dict):
            fields = {key: decode(item) for key, item in value.items()}
            kind = _KINDS[fields.pop("kind")]
            types = get_type_hints(kind)
            for key, item in fields.items():
                check_type(
                    item, types[key], collection_check_strategy=CollectionCheckStrategy.ALL_ITEMS
                )
            return kind(**fields)
        if isinstance(value, int | float) and not abs(value) <= 10_000:
            raise ValueError(f"{value:.6g} is beyond 10000")
        return tuple(decode(item) for item in value) if isinstance(value, list) else value

    try:
        config = decode(_convert_legacy(json.loads(text)))
    except (AttributeError, KeyError, TypeError, IndexError, TypeCheckError) as error:
        raise ValueError(f"not a model configuration of this version: {error}") from error
    if not isinstance(config, ModelConfig):
        raise ValueError("not a model configuration")
    return config


def convert_legacy_names(variables: Mapping[str, Any]) -> dict[str, Any]:
    """Rename variables of earlier versions, given by their paths such as ``params/conv/kernel``.

    Example:
        >>> convert_legacy_names({"params/sectors/choice/stay": 3.0})
        {'params/selector/stay': 3.0}
    """
    return {
        re.sub("^params/sectors/choice/", "params/selector/", name): value
        for name, value in variables.items()
    }


def _convert_legacy(description: dict[str, Any]) -> dict[str, Any]:
    """Convert a description of an earlier version; in 0.1 one class configured both networks."""
    if description.get("kind") in ("ProposalConfig", "ProposalNetConfig"):
        description = {**description, "kind": "ProposalNetConfig"}
        # Support took the place of a weighted median, which had no weights either.
        if description.pop("weighted_median", {}) is None:
            description["support"] = None
        return description
    if description.get("kind") != "NetworkConfig":
        return description
    first, *others = description["stages"]
    if description["views"] is None:
        return _legacy_proposal(description, first, others[0])
    stages = [
        {
            **{name: stage[name] for name in ("kind", "candidates", "volume", "occlusion")},
            "attention": stage["attention"],
            "aggregation": {**stage["aggregation"], "kind": "AggregationConfig"},
        }
        for stage in (first, *others)
    ]
    kept = {name: value for name, value in description.items() if name != "reach"}
    return {**kept, "kind": "OccCasNetConfig", "stages": stages}


def _legacy_proposal(description: dict, search: dict, choice: dict) -> dict[str, Any]:
    semi_global, selector = search["semi_global"], choice["aggregation"]
    candidates = search["candidates"]
    return {
        "kind": "ProposalNetConfig",
        "costs": {**description["features"], "kind": "CostConfig"},
        "search": {
            "kind": "SearchConfig",
            "interval": candidates[1] - candidates[0],
            "default_limit": candidates[-1],
            "smoothness": semi_global["smoothness"],
            "max_edge_penalty": semi_global["jump"],
            "edge_contrast": semi_global["edge"],
            "temperature": semi_global["temperature"],
        },
        "refinement": {"kind": "RefinementConfig", "steps": choice["plane_steps"]},
        "proposals": {
            "kind": "ProposalsConfig",
            "offsets": choice["neighbours"],
            "min_second_distance": choice["second"],
        },
        "selector": {
            "kind": "SelectorConfig",
            "width": selector["width"],
            "context": selector["context"],
            "window": choice["window"],
        },
        "reach": description["reach"],
    }
