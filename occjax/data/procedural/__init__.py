"""Random light fields with exact ground truth, as a pure function of a random key.

:func:`generate` draws a light field from the distribution that a :class:`SceneConfig` describes:

* :mod:`~occjax.data.procedural.scenes` draws the surfaces;
* :mod:`~occjax.data.procedural.appearance` draws their materials and the light;
* :mod:`~occjax.data.procedural.patterns` draws textures and outlines;
* :mod:`~occjax.data.procedural.surfaces` intersects every ray of every view with every surface in
  closed form;
* :mod:`~occjax.data.procedural.shading` computes the brightness of the nearest hits;
* :mod:`~occjax.data.procedural.sensor` adds camera defects.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from occjax.lazy import lazy_names

if TYPE_CHECKING:
    from occjax.data.procedural.config import (
        TEXTURED,
        Defects,
        Outlines,
        SceneConfig,
        Solids,
        Textures,
    )
    from occjax.data.procedural.generator import generate

__all__ = ["TEXTURED", "Defects", "Outlines", "SceneConfig", "Solids", "Textures", "generate"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "occjax.data.procedural.config": (
            *("TEXTURED", "Defects", "Outlines", "SceneConfig", "Solids", "Textures"),
        ),
        "occjax.data.procedural.generator": ("generate",),
    },
)
