"""The virtual bench behind a ``sim://`` address: NI-DAQmx service, strict device, plant, sensors, camera and clock."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
