"""Viewer in the browser: point cloud, views, refocusing, and what the views see at a pixel."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
