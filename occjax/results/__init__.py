"""Results of an estimate: the folder of files, and conversions between disparity, depth, points."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
