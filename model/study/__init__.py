"""Parameter studies: one blow on variants of an action; those of the thesis (Sections 4.2.2, 4.4) among them."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
