from .config import (
    PRESETS as PRESETS,
)
from .config import (
    CostConfig as CostConfig,
)
from .config import (
    ExposureConfig as ExposureConfig,
)
from .config import (
    NoiseConfig as NoiseConfig,
)
from .config import (
    ProposalConfig as ProposalConfig,
)
from .config import (
    ProposalsConfig as ProposalsConfig,
)
from .config import (
    RefinementConfig as RefinementConfig,
)
from .config import (
    SearchConfig as SearchConfig,
)
from .config import (
    SelectorConfig as SelectorConfig,
)
from .network import (
    ProposalNet as ProposalNet,
)
from .network import (
    ProposalOutput as ProposalOutput,
)
from .network import (
    Selection as Selection,
)
