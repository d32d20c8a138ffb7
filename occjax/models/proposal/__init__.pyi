from .config import (
    PRESETS as PRESETS,
    ConfidenceConfig as ConfidenceConfig,
    CostConfig as CostConfig,
    ExposureConfig as ExposureConfig,
    NoiseConfig as NoiseConfig,
    PlanarConfig as PlanarConfig,
    ProposalNetConfig as ProposalNetConfig,
    ProposalsConfig as ProposalsConfig,
    RefinementConfig as RefinementConfig,
    ResidualConfig as ResidualConfig,
    SearchConfig as SearchConfig,
    SelectorConfig as SelectorConfig,
    SupportConfig as SupportConfig,
)
from .network import (
    ProposalNet as ProposalNet,
    ProposalOutput as ProposalOutput,
    Selection as Selection,
)
