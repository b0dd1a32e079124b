"""The calls of the DAQmx service, in tables by their names: device, tasks, channels, timing, data, waveforms, watchdog.

In: the device's state, the task and the request.
Out: the response; configuring calls return nothing, their responses are empty.
"""
