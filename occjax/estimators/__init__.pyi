from .all_views import (
    CrossViewConfig as CrossViewConfig,
    estimate_all_views as estimate_all_views,
)
from .driver import (
    estimate as estimate,
    estimate_occlusion as estimate_occlusion,
    export_estimator as export_estimator,
    run_estimator as run_estimator,
)
from .factory import make_estimator as make_estimator
from .protocol import (
    Estimate as Estimate,
    Estimator as Estimator,
    ModelInputs as ModelInputs,
    ViewMaps as ViewMaps,
)
