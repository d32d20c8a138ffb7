"""View order and disparity range, measured from photo-consistency.

The modules follow the order of the data: :mod:`~occjax.layout.orientation` defines the eight view
orders, :mod:`~occjax.layout.consistency` compares the views under each of them,
:mod:`~occjax.layout.disparity_range` estimates the disparities,
:mod:`~occjax.layout.occlusion_order` determines their sign, and :mod:`~occjax.layout.report`
combines the results.
"""

from occjax.layout.config import RegistrationConfig, ViewOrderConfig
from occjax.layout.orientation import (
    ORIENTATIONS,
    Orientation,
    declaration,
    declared_orientation,
)
from occjax.layout.registration import Registration
from occjax.layout.report import (
    ViewOrderReport,
    check,
    describe,
    disparity_range_of,
    registered,
    view_order_scores,
)

__all__ = [
    "ORIENTATIONS",
    "Orientation",
    "Registration",
    "RegistrationConfig",
    "ViewOrderConfig",
    "ViewOrderReport",
    "check",
    "declaration",
    "declared_orientation",
    "describe",
    "disparity_range_of",
    "registered",
    "view_order_scores",
]
