"""The bench: motor profiles, channels, backends, DAQ tasks, interlocks, the recorder and session files.

Profiles and rig files in; sealed session folders out, for ``vision`` and ``validation`` to read. Public names stand in
``__init__.pyi``, which type checkers and editors read; each is imported on first use: the NI-DAQmx client only when a
backend is opened, the virtual bench (``rig.simulated``) only for a ``sim://`` address.

    session = rig.record("sessions/try", profile="forte", trials=2, backend="sim://")
    force = session[1].corrected_force()
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
