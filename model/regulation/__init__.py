"""Regulation of an action: seven targets measured as a technician does, seven screws turned to meet them."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
