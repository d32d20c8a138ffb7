from . import (
    data as data,
)
from . import (
    estimators as estimators,
)
from . import (
    evaluation as evaluation,
)
from . import (
    io as io,
)
from . import (
    layout as layout,
)
from . import (
    models as models,
)
from . import (
    ops as ops,
)
from . import (
    results as results,
)
from . import (
    training as training,
)
from . import (
    viz as viz,
)
from .errors import InputError as InputError
from .estimators import (
    Estimate as Estimate,
)
from .estimators import (
    Estimator as Estimator,
)
from .estimators import (
    estimate as estimate,
)
from .estimators import (
    make_estimator as make_estimator,
)
from .io import load as load
from .layout import check as check
from .lightfield import Calibration as Calibration
from .lightfield import LightField as LightField

__version__: str
