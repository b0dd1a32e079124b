"""NI-DAQmx backend: the bench's tasks on the real ``nidaqmx`` client, always, whatever answers at the other
end.

Place in the data flow: :func:`open_backend` is the entry point of the addresses ``ni://local`` (NI-DAQmx
driver of this computer) and ``ni-grpc://host:31763`` (NI gRPC Device Server). No type, constant or exception
of ``nidaqmx`` leaves this package.
"""

from rig.daq.address import open_backend
from rig.daq.nidaqmx_backend import NidaqmxBackend

__all__ = ["NidaqmxBackend", "open_backend"]
