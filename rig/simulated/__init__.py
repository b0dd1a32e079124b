"""The virtual bench behind a ``sim://`` address: NI-DAQmx service, strict device, plant, sensors, camera and clock.

In: the calls that ``rig.daq`` makes with the real ``nidaqmx`` client; a bench file. Out: the
answers the real products would give, films of the action, and the truth of each trial. The hardware path never imports
this package; it is reached through the entry point ``sim`` of ``pianorig.backends``.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
