"""NI-DAQmx backend: the bench's tasks on the real ``nidaqmx`` client, whatever answers at the other end."""

from rig.daq.address import open_backend
from rig.daq.nidaqmx_backend import NidaqmxBackend

__all__ = ["NidaqmxBackend", "open_backend"]
