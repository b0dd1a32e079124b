"""Inside view of a motion: forces, sliding, losses and accelerations at each contact, joint and body.

`state_observer` evaluates single states, `observe_motion` a whole run (NumPy and the model's kernels only); ``figure``
draws the result. The record itself, `Inside`, travels in a `Solution`.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
