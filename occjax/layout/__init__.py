"""View order and disparity range, measured from photo-consistency.

The modules follow the order of the data: :mod:`~occjax.layout.brightness` finds the views that
can be used and their gains, :mod:`~occjax.layout.orientation` defines the eight view orders,
:mod:`~occjax.layout.consistency` compares the views under each of them,
:mod:`~occjax.layout.disparity_range` estimates the disparities,
:mod:`~occjax.layout.occlusion_order` determines their sign, and :mod:`~occjax.layout.report`
combines the results.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
