from .driver import (
    estimate as estimate,
)
from .driver import (
    estimate_occlusion as estimate_occlusion,
)
from .driver import (
    export_estimator as export_estimator,
)
from .driver import (
    run_estimator as run_estimator,
)
from .factory import make_estimator as make_estimator
from .protocol import Estimate as Estimate
from .protocol import Estimator as Estimator
from .protocol import ModelInputs as ModelInputs
