"""What stands behind an NI-DAQmx driver or server: devices, modules, serial numbers, driver version.

In: a driver of this computer or a channel to a gRPC Device Server.
Out: plain records, for sessions, ``pianorig info --backend`` and the rig file it proposes.
"""
