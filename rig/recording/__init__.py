"""Recording: trials of one profile or a plan on a backend, into a session; resuming and recovering it."""

import lazy_loader as _lazy

# so that rig.recorder.record_session works after "import rig"
__getattr__, __dir__, __all__ = _lazy.attach(__name__, ["recorder"])
