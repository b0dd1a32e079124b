"""Recordings made by other programs: channels of CSV, LabVIEW ``.lvm``, TDMS and HDF5 files, by name.

Place in the data flow: ``learn`` takes a recorded force from here, ``import`` whole sessions. Every reader gives a
:class:`ChannelTable` or refuses the file with :class:`rig.errors.RigInputError` in one line.
"""

from rig.foreign.channel_table import ChannelTable
from rig.foreign.reading import read_channels

__all__ = ["ChannelTable", "read_channels"]
