"""Layout of the grid of views and disparity range, measured from photo-consistency.

The modules follow the order of the data: :mod:`~occjax.layout.orientation` names the eight layouts,
:mod:`~occjax.layout.consistency` compares the views under each of them,
:mod:`~occjax.layout.disparity_range` reads off the disparities,
:mod:`~occjax.layout.occlusion_order` decides their sign, and :mod:`~occjax.layout.report` combines
the results.
"""

from occjax.layout.config import LayoutConfig
from occjax.layout.orientation import (
    ORIENTATIONS,
    Orientation,
    declaration,
    declared_orientation,
)
from occjax.layout.report import LayoutReport, check, disparity_range_of

__all__ = [
    "ORIENTATIONS",
    "LayoutConfig",
    "LayoutReport",
    "Orientation",
    "check",
    "declaration",
    "declared_orientation",
    "disparity_range_of",
]
