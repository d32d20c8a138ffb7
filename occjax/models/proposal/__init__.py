"""ProposalNet: a light network for any arrangement of views and any range of disparities.

It searches semi-globally, refines by slanted planes, proposes the surfaces of neighbouring pixels
and selects among them; only the selection is learned. Without the selector it is the training-free
estimator.

Reading order, which is the order of the data: :mod:`config`, :mod:`exposure`, :mod:`noise`,
:mod:`costs`, :mod:`semi_global`, :mod:`search`, :mod:`planes`, :mod:`sector_costs`,
:mod:`proposals`, :mod:`selector`, :mod:`support`, :mod:`residual`, :mod:`planar`, :mod:`voting`,
:mod:`network`. :mod:`aperture`, :mod:`filters` and :mod:`resolution` hold what several steps use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
