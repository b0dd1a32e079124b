"""Recordings made by other programs: channels of text, LabVIEW ``.lvm``, TDMS, HDF5 and MATLAB files, by name.

In: such a file, and a mapping file that says which channel is what.
Out: a :class:`~rig.foreign.channel_table.ChannelTable`, or a whole session folder.
"""

from rig.foreign.channel_table import ChannelTable
from rig.foreign.reading import read_channels

__all__ = ["ChannelTable", "read_channels"]
