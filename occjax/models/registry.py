"""All models by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Literal

from occjax.errors import InputError, nearest
from occjax.models.occcasnet.config import OccCasNetConfig
from occjax.models.occcasnet.presets import PRESETS as OCCCASNET_PRESETS
from occjax.models.proposal.config import PRESETS as PROPOSAL_PRESETS, ProposalNetConfig

ModelConfig = OccCasNetConfig | ProposalNetConfig

Precision = Literal["float32", "bfloat16"]
"""Type of a network's convolutions; parameters stay float32."""

PRESETS: Mapping[str, ModelConfig] = MappingProxyType({**PROPOSAL_PRESETS, **OCCCASNET_PRESETS})
"""Configurations by model name."""

ALIASES: Mapping[str, str] = MappingProxyType(
    {"light": "proposal", "light_small": "proposal_small", "light_large": "proposal_large"}
)
"""Former names of models."""


def preset(name: str, **changes: Any) -> Any:
    """Return the configuration of a model by its name.

    Args:
        name: One of :data:`PRESETS` or :data:`ALIASES`.
        **changes: Fields to replace, for instance ``warp="transposed"``.

    Returns:
        :class:`OccCasNetConfig` or :class:`ProposalNetConfig`.

    Raises:
        InputError: If there is no model of that name.

    Example:
        >>> [len(stage.candidates) for stage in preset("occcasnet").stages]
        [33, 9]
    """
    name = ALIASES.get(name, name)
    if name not in PRESETS:
        advice = nearest(
            name,
            [*PRESETS, *ALIASES],
            otherwise="choose 'proposal' or 'photometric', or run occjax weights list for others",
        )
        raise InputError(f"there is no model {name!r}; {advice}")
    return replace(PRESETS[name], **changes)


def preset_name(config: ModelConfig) -> str:
    """Return the name of a configuration; ``"custom"`` if it has none.

    OccCasNet has the same name for either warp, ProposalNet with and without a residual.

    Example:
        >>> preset_name(preset("occcasnet", warp="transposed"))
        'occcasnet'
    """
    for name, known in PRESETS.items():
        if isinstance(config, OccCasNetConfig) and isinstance(known, OccCasNetConfig):
            known = replace(known, warp=config.warp)
        if isinstance(config, ProposalNetConfig) and config.residual is None:
            known = without_residual(known)
        if known == config:
            return name
    return "custom"


def without_residual(config: ModelConfig) -> ModelConfig:
    """Return the configuration of a model of an earlier version, which had no residual."""
    if isinstance(config, ProposalNetConfig):
        return replace(config, residual=None)
    return config


def variable_shapes(config: ModelConfig) -> dict:
    """Return shapes and types of a model's variables without computing any.

    Args:
        config: Configuration of a model.

    Returns:
        ``variables`` with a ``jax.ShapeDtypeStruct`` for each array.

    Example:
        >>> variable_shapes(preset("proposal"))["params"]["selector"]["stay"].shape
        ()
    """
    # The networks import Flax, which takes long.
    if isinstance(config, OccCasNetConfig):
        from occjax.models.occcasnet.network import variable_shapes as occcasnet_shapes

        return occcasnet_shapes(config)
    from occjax.models.proposal.network import variable_shapes as proposal_shapes

    return proposal_shapes(config)
