from .brightness import ViewBrightness as ViewBrightness
from .brightness import view_brightness as view_brightness
from .config import (
    BrightnessConfig as BrightnessConfig,
)
from .config import (
    RegistrationConfig as RegistrationConfig,
)
from .config import (
    ViewOrderConfig as ViewOrderConfig,
)
from .orientation import (
    ORIENTATIONS as ORIENTATIONS,
)
from .orientation import (
    Orientation as Orientation,
)
from .orientation import (
    declaration as declaration,
)
from .orientation import (
    declared_orientation as declared_orientation,
)
from .registration import Registration as Registration
from .report import (
    ViewOrderReport as ViewOrderReport,
)
from .report import (
    check as check,
)
from .report import (
    disparity_range_of as disparity_range_of,
)
from .report import (
    registered as registered,
)
