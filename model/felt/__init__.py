"""Laws of felt and what measured presses say of them: the thesis's, Stulov's with memory, one with a history."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
