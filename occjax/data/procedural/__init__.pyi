from .config import (
    TEXTURED as TEXTURED,
)
from .config import (
    Defects as Defects,
)
from .config import (
    Outlines as Outlines,
)
from .config import (
    SceneConfig as SceneConfig,
)
from .config import (
    Solids as Solids,
)
from .config import (
    Textures as Textures,
)
from .generator import generate as generate
