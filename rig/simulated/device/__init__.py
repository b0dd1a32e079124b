"""The state of the virtual device: tasks, reservations, watchdog timers, injected faults; no time passes here.

In: the product (:mod:`rig.simulated.product`) and the bench (:mod:`rig.simulated.bench`) the device is wired to.
Out: :class:`rig.simulated.device.state.DeviceState`, the record that signals, timing and driver read and change.
"""
