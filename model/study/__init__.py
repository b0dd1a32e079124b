"""Parameter studies: one blow on variants of an action; those of the thesis (Sections 4.2.2, 4.4) among them."""

import lazy_loader as _lazy

from model.package_calls import refuse_call as _refuse_call

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
_refuse_call(__name__, "model.study.compare(action, time_s, force_n, variants)")
