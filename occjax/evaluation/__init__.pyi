from .benchmark import (
    SceneScores as SceneScores,
)
from .benchmark import (
    evaluate_scene as evaluate_scene,
)
from .benchmark import (
    metric_names as metric_names,
)
from .files import evaluate_files as evaluate_files
from .files import read_disparity as read_disparity
from .metrics import (
    BAD_PIXEL_THRESHOLD as BAD_PIXEL_THRESHOLD,
)
from .metrics import (
    BORDER as BORDER,
)
from .metrics import (
    THRESHOLDS as THRESHOLDS,
)
from .metrics import (
    Metrics as Metrics,
)
from .metrics import (
    bad_pix as bad_pix,
)
from .metrics import (
    compared_pixels as compared_pixels,
)
from .metrics import (
    default_border as default_border,
)
from .metrics import (
    evaluate as evaluate,
)
from .metrics import (
    mean_squared_error as mean_squared_error,
)
from .metrics import (
    q25 as q25,
)
from .normals import angular_errors as angular_errors
from .regions import (
    bumpiness as bumpiness,
)
from .regions import (
    fattening as fattening,
)
from .regions import (
    foreground_fattening as foreground_fattening,
)
from .regions import (
    foreground_thinning as foreground_thinning,
)
from .regions import (
    missed_dots as missed_dots,
)
from .regions import (
    thinning as thinning,
)
from .scene_files import is_scene as is_scene
from .scene_files import read_mask as read_mask
