"""How good an estimate is: the error measures of the HCI 4D benchmark."""

from occjax.evaluation.files import evaluate_files, read_disparity
from occjax.evaluation.metrics import (
    BORDER,
    THRESHOLDS,
    Metrics,
    bad_pix,
    evaluate,
    mean_squared_error,
    q25,
)
from occjax.evaluation.published import (
    average,
    printed_average,
    published_methods,
    published_scores,
)

__all__ = [
    "BORDER",
    "THRESHOLDS",
    "Metrics",
    "average",
    "bad_pix",
    "evaluate",
    "evaluate_files",
    "mean_squared_error",
    "printed_average",
    "published_methods",
    "published_scores",
    "q25",
    "read_disparity",
]
