"""What if: the same blow on variants of one action; the thesis's studies (Section 4.4) checked line by line."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
