"""Pictures, and figures with colour bars, of disparity, depth, confidence, error and occlusion."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
