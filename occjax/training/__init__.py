"""Training: settings, losses, the step, the loop, checkpoints and validation.

Reading order: :mod:`config`, :mod:`recipes`, :mod:`data`, :mod:`loop`, :mod:`step`, :mod:`tasks`;
then the task of a model, :mod:`occcasnet` or :mod:`proposal`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
