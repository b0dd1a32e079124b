"""Parameter studies: one blow on variants of an action; the thesis's studies (Section 4.4) as computed checks.

An action, a force table and `variants` in; solutions and `blow_measures` out. `thesis` repeats the published studies,
`figure` draws them.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
