from . import (
    data as data,
    estimators as estimators,
    evaluation as evaluation,
    io as io,
    layout as layout,
    models as models,
    ops as ops,
    results as results,
    training as training,
    viewer as viewer,
    viz as viz,
)
from .errors import InputError as InputError
from .estimators import (
    Estimate as Estimate,
    Estimator as Estimator,
    estimate as estimate,
    make_estimator as make_estimator,
)
from .io import load as load
from .layout import check as check
from .lightfield import Calibration as Calibration, LightField as LightField
from .ops import all_in_focus as all_in_focus, refocus as refocus

__version__: str
