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

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
