"""Recordings made by other programs: channels of text, LabVIEW ``.lvm``, TDMS, HDF5 and MATLAB files, by name."""

from rig.foreign.channel_table import ChannelTable
from rig.foreign.reading import read_channels

__all__ = ["ChannelTable", "read_channels"]
