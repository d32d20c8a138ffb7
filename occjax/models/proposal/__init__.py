"""ProposalNet: a light network for any arrangement of views and any range of disparities.

It searches semi-globally, refines by slanted planes, proposes the surfaces of neighbouring pixels
and selects among them; only the selection is learned. Without the selector it is the training-free
estimator.

Reading order, which is the order of the data: :mod:`config`, :mod:`exposure`, :mod:`noise`,
:mod:`costs`, :mod:`semi_global`, :mod:`search`, :mod:`planes`, :mod:`sector_costs`,
:mod:`proposals`, :mod:`selector`, :mod:`network`. :mod:`aperture`, :mod:`filters` and
:mod:`resolution` hold what several steps use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from occjax.lazy import lazy_names

if TYPE_CHECKING:
    from occjax.models.proposal.config import (
        PRESETS,
        CostConfig,
        ExposureConfig,
        NoiseConfig,
        ProposalConfig,
        ProposalsConfig,
        RefinementConfig,
        SearchConfig,
        SelectorConfig,
    )
    from occjax.models.proposal.network import ProposalNet, ProposalOutput, Selection

__all__ = [
    "PRESETS",
    "CostConfig",
    "ExposureConfig",
    "NoiseConfig",
    "ProposalConfig",
    "ProposalNet",
    "ProposalOutput",
    "ProposalsConfig",
    "RefinementConfig",
    "SearchConfig",
    "Selection",
    "SelectorConfig",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "occjax.models.proposal.config": (
            "PRESETS",
            "CostConfig",
            "ExposureConfig",
            "NoiseConfig",
            "ProposalConfig",
            "ProposalsConfig",
            "RefinementConfig",
            "SearchConfig",
            "SelectorConfig",
        ),
        "occjax.models.proposal.network": ("ProposalNet", "ProposalOutput", "Selection"),
    },
)
