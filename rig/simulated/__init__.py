"""The virtual bench: NI-DAQmx service, strict device, plant, sensors, camera and clock behind a ``sim://``
address.

The hardware path never imports this package; it is reached only through the entry point ``sim`` of
``pianorig.backends``.
"""
