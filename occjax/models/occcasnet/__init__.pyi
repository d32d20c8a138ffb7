from .config import (
    AggregationConfig as AggregationConfig,
    FeatureConfig as FeatureConfig,
    OccCasNetConfig as OccCasNetConfig,
    StageConfig as StageConfig,
)
from .network import OccCasNet as OccCasNet
from .prediction import predict as predict
from .presets import PRESETS as PRESETS, evenly_spaced as evenly_spaced
from .published_weights import fetch_published_weights as fetch_published_weights
from .stages import StageOutput as StageOutput
