from .brightness import ViewBrightness as ViewBrightness, view_brightness as view_brightness
from .config import (
    BrightnessConfig as BrightnessConfig,
    RegistrationConfig as RegistrationConfig,
    ViewOrderConfig as ViewOrderConfig,
)
from .orientation import (
    ORIENTATIONS as ORIENTATIONS,
    Orientation as Orientation,
    declaration as declaration,
    declared_orientation as declared_orientation,
    straightened as straightened,
)
from .registration import Registration as Registration
from .report import (
    ViewOrderReport as ViewOrderReport,
    check as check,
    disparity_range_of as disparity_range_of,
    registered as registered,
)
