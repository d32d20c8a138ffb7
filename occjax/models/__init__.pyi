from .occcasnet import (
    AggregationConfig as AggregationConfig,
)
from .occcasnet import (
    FeatureConfig as FeatureConfig,
)
from .occcasnet import (
    OccCasNet as OccCasNet,
)
from .occcasnet import (
    OccCasNetConfig as OccCasNetConfig,
)
from .occcasnet import (
    StageConfig as StageConfig,
)
from .occcasnet import (
    StageOutput as StageOutput,
)
from .occcasnet import (
    fetch_published_weights as fetch_published_weights,
)
from .occcasnet import (
    predict as predict,
)
from .occcasnet import (
    sampled as sampled,
)
from .proposal import (
    ProposalConfig as ProposalConfig,
)
from .proposal import (
    ProposalNet as ProposalNet,
)
from .proposal import (
    ProposalOutput as ProposalOutput,
)
from .registry import (
    ALIASES as ALIASES,
)
from .registry import (
    PRESETS as PRESETS,
)
from .registry import (
    ModelConfig as ModelConfig,
)
from .registry import (
    preset as preset,
)
from .registry import (
    variable_shapes as variable_shapes,
)
from .weights import load_weights as load_weights
from .weights import save_weights as save_weights
