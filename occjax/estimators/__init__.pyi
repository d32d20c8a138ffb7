from .driver import (
    estimate as estimate,
    estimate_occlusion as estimate_occlusion,
    export_estimator as export_estimator,
    run_estimator as run_estimator,
)
from .factory import make_estimator as make_estimator
from .protocol import Estimate as Estimate, Estimator as Estimator, ModelInputs as ModelInputs
