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
    compared_pixels as compared_pixels,
    default_border as default_border,
    evaluate as evaluate,
)
from .normals import angular_errors as angular_errors
from .regions import (
    bumpiness as bumpiness,
    fattening as fattening,
    missed_dots as missed_dots,
    wrong_layer as wrong_layer,
)
from .scene_files import is_scene as is_scene, read_mask as read_mask
