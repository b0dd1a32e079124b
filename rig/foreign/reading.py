"""Choosing the reader by the ending of a file's name."""

from __future__ import annotations

from pathlib import Path

from rig.errors import InputError
from rig.foreign.channel_table import ChannelTable

SUFFIXES = (".csv", ".txt", ".lvm", ".tdms", ".h5", ".hdf5")


def read_channels(path: str | Path, *, separator: str = ",", decimal: str = ".") -> ChannelTable:
    """Read all channels of a recording; ``separator`` and ``decimal`` are for CSV only.

    Raises
    ------
    InputError
        When the ending is not known or the file cannot be used.
    """
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix in (".csv", ".txt"):
        from rig.foreign.csv_text import read_csv

        return read_csv(file, separator, decimal)
    if suffix == ".lvm":
        from rig.foreign.lvm_text import read_lvm

        return read_lvm(file)
    if suffix == ".tdms":
        from rig.foreign.tdms_file import read_tdms

        return read_tdms(file)
    if suffix in (".h5", ".hdf5"):
        from rig.foreign.hdf5_file import read_hdf5

        return read_hdf5(file)
    raise InputError(f"{file}: ending {suffix!r}, allowed {', '.join(SUFFIXES)}")
