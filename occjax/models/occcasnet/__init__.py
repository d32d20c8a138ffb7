"""OccCasNet: the paper's network and its variants.

Reading order: :mod:`config`, :mod:`features`, :mod:`aggregation`, :mod:`network`, :mod:`stages`;
then :mod:`prediction`, the same network in strips for images of any size.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
