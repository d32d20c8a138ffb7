from .occcasnet import (
    AggregationConfig as AggregationConfig,
    FeatureConfig as FeatureConfig,
    OccCasNet as OccCasNet,
    OccCasNetConfig as OccCasNetConfig,
    StageConfig as StageConfig,
    StageOutput as StageOutput,
    evenly_spaced as evenly_spaced,
    fetch_published_weights as fetch_published_weights,
    predict as predict,
)
from .proposal import (
    ProposalNet as ProposalNet,
    ProposalNetConfig as ProposalNetConfig,
    ProposalOutput as ProposalOutput,
)
from .registry import (
    ALIASES as ALIASES,
    PRESETS as PRESETS,
    ModelConfig as ModelConfig,
    preset as preset,
    variable_shapes as variable_shapes,
)
from .weights import load_weights as load_weights, save_weights as save_weights
