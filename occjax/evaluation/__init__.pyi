from .benchmark import (
    SceneScores as SceneScores,
    evaluate_scene as evaluate_scene,
    metric_names as metric_names,
)
from .files import evaluate_files as evaluate_files, read_disparity as read_disparity
from .metrics import (
    BAD_PIXEL_THRESHOLD as BAD_PIXEL_THRESHOLD,
    BORDER as BORDER,
    THRESHOLDS as THRESHOLDS,
    Metrics as Metrics,
    bad_pix as bad_pix,
    compared_pixels as compared_pixels,
    default_border as default_border,
    evaluate as evaluate,
    mean_squared_error as mean_squared_error,
    q25 as q25,
)
from .normals import angular_errors as angular_errors
from .regions import (
    bumpiness as bumpiness,
    fattening as fattening,
    foreground_fattening as foreground_fattening,
    foreground_thinning as foreground_thinning,
    missed_dots as missed_dots,
    thinning as thinning,
)
from .scene_files import is_scene as is_scene, read_mask as read_mask
