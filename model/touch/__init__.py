"""Touch of an action: touch weights, hammer speed against force, fastest repetition; several actions side by side."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
