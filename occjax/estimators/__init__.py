"""Estimators: from a light field to a disparity map.

``cli -> driver.run_estimator -> an Estimator (prepare, run, finish) -> its model``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
