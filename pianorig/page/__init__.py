"""The bench in a browser: one local page, served from this computer to this computer, that works without internet."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
