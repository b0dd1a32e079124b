"""What the NI-DAQmx driver does for a client: creates, configures, starts and stops tasks, reads and writes samples.

In: calls with checked types, from :mod:`rig.simulated.rpc`.
Out: samples, or the driver's status code for what the product refuses.
"""
