from .config import (
    TEXTURED as TEXTURED,
    Defects as Defects,
    Outlines as Outlines,
    SceneConfig as SceneConfig,
    Solids as Solids,
    Textures as Textures,
)
from .generator import generate as generate, true_disparities as true_disparities
