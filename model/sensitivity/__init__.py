"""Sensitivities: derivatives of a blow with respect to the parameters of an action, and what they say."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
