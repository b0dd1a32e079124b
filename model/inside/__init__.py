"""Inside view of a motion: forces, sliding, losses and accelerations at each contact, joint and body."""

import lazy_loader as _lazy

from model.package_calls import refuse_call as _refuse_call

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
_refuse_call(__name__, "model.simulate(action, trial, inside=True)")
