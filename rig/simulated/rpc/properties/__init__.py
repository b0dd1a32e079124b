"""The properties a client may get and set, in tables by the driver's names: of devices, tasks and channels.

In: the device's state and the driver's number of a property.
Out: its value; what is not in a table is refused.
"""
