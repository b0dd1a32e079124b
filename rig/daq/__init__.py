"""NI-DAQmx backend: the bench's tasks on the real ``nidaqmx`` client, whatever answers at the other end.

In: addresses ``ni://local`` (NI-DAQmx driver of this computer) and ``ni-grpc://host:31763`` (NI gRPC Device Server).
Out: the backend of :mod:`rig.backend`; no type, constant or exception of ``nidaqmx`` leaves this package.
"""

from rig.daq.address import open_backend
from rig.daq.nidaqmx_backend import NidaqmxBackend

__all__ = ["NidaqmxBackend", "open_backend"]
