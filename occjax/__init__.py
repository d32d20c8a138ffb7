"""occjax: disparity from light fields by occlusion-aware cascade cost volumes, in JAX.

Read a light field with :func:`load` and estimate the disparity of its centre view with
:func:`estimate`. The differentiable cost-volume functions are in :mod:`occjax.ops`, the networks in
:mod:`occjax.models`.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
