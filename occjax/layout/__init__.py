"""View order and disparity range, measured from photo-consistency.

The modules follow the order of the data: :mod:`~occjax.layout.brightness` finds the views that
can be used and their gains, :mod:`~occjax.layout.orientation` defines the eight view orders,
:mod:`~occjax.layout.consistency` compares the views under each of them,
:mod:`~occjax.layout.disparity_range` estimates the disparities,
:mod:`~occjax.layout.occlusion_order` determines their sign, and :mod:`~occjax.layout.report`
combines the results.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from occjax.lazy import lazy_names

if TYPE_CHECKING:
    from occjax.layout.brightness import ViewBrightness, view_brightness
    from occjax.layout.config import BrightnessConfig, RegistrationConfig, ViewOrderConfig
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
        disparity_range_of,
        registered,
    )

__all__ = [
    "ORIENTATIONS",
    "BrightnessConfig",
    "Orientation",
    "Registration",
    "RegistrationConfig",
    "ViewBrightness",
    "ViewOrderConfig",
    "ViewOrderReport",
    "check",
    "declaration",
    "declared_orientation",
    "disparity_range_of",
    "registered",
    "view_brightness",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "occjax.layout.config": ("BrightnessConfig", "RegistrationConfig", "ViewOrderConfig"),
        "occjax.layout.orientation": (
            "ORIENTATIONS",
            "Orientation",
            "declaration",
            "declared_orientation",
        ),
        "occjax.layout.registration": ("Registration",),
        "occjax.layout.report": (
            "ViewOrderReport",
            "check",
            "disparity_range_of",
            "registered",
        ),
        "occjax.layout.brightness": ("ViewBrightness", "view_brightness"),
    },
)
