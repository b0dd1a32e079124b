"""Inside view of a motion: what acts, slides, loses energy and accelerates at each contact, joint and body.

`observe` computes it (NumPy and the model's kernels only); ``figure`` and ``animation`` draw it and are imported by
name when something is drawn.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
