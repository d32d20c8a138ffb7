"""Phases of an estimate, as the progress of a command shows them."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum


class Phase(StrEnum):
    """Phases in their order, by the words that users read."""

    READING = "reading"
    PREPARING = "preparing"
    LOADING_PROGRAM = "loading the program"
    COMPILING = "compiling, once for this size and number of views"
    ESTIMATING = "estimating"
    OCCLUSION_MAPS = "occlusion maps"
    COMPARING_VIEWS = "comparing the views"
    WRITING = "writing"
    FAILED = "failed"


ReportPhase = Callable[[str], None]
"""Function that is called when a phase begins.

Its argument is a :class:`Phase`; if several views are estimated, also with the number of the view.
"""
