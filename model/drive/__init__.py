"""The drive of a bench's motor: what it does in a run, and its numbers from a log of the bench."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
