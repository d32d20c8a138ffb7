from .config import (
    AggregationConfig as AggregationConfig,
)
from .config import (
    FeatureConfig as FeatureConfig,
)
from .config import (
    OccCasNetConfig as OccCasNetConfig,
)
from .config import (
    StageConfig as StageConfig,
)
from .network import OccCasNet as OccCasNet
from .prediction import predict as predict
from .presets import PRESETS as PRESETS
from .presets import sampled as sampled
from .published_weights import fetch_published_weights as fetch_published_weights
from .stages import StageOutput as StageOutput
