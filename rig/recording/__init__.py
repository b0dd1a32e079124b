"""Recording: trials of one profile or a plan on a backend, into a session; resuming and recovering it.

In: profile or plan, rig file, an open backend, :class:`rig.recording.options.RecordingOptions`.
Out: a session folder of sealed trials; a journal where the program was killed.
"""

import lazy_loader as _lazy

# so that rig.recorder.record_session works after "import rig"
__getattr__, __dir__, __all__ = _lazy.attach(__name__, ["recorder"])
