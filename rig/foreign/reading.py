"""The readers of foreign recordings, chosen by the ending of a file's name: text, LabVIEW text, TDMS, HDF5 and MATLAB.

Segments of a file are joined only where the file's own times continue from one to the next, or where it states none.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable, known_unit
from rig.foreign.csv_file import parse_csv, read_text
from rig.foreign.hdf5_file import read_hdf5
from rig.foreign.lvm_file import parse_lvm
from rig.foreign.mapping import NEWTONS
from rig.foreign.mat_file import read_mat
from rig.foreign.sample_times import SECONDS

TEXT = (".csv", ".txt", ".tsv", ".dat", ".asc", ".prn")
HDF5 = (".h5", ".hdf5", ".nc")
SUFFIXES = (*TEXT, ".csv.gz", ".txt.gz", ".lvm", ".tdms", *HDF5, ".mat")


def read_segments(
    path: str | Path,
    *,
    separator: str = ",",
    decimal: str = ".",
    thousands: str = "",
    names_row: int | None = None,
    skip_rows: int = 0,
) -> tuple[ChannelTable, ...]:
    """Read all channels of a recording, by the ending of its name (text, LVM, TDMS, HDF5, MATLAB), one table a segment;
    the options are those of CSV: signs, line of the names from 1, lines to skip."""
    file = Path(path)
    suffix = "".join(file.suffixes[-2:]).lower() if file.suffix.lower() == ".gz" else file.suffix.lower()
    if suffix in (*TEXT, ".csv.gz", ".txt.gz"):
        text = read_text(file)
        return (parse_csv(text, str(file), separator, decimal, thousands, names_row=names_row, skip_rows=skip_rows),)
    if suffix == ".lvm":
        return parse_lvm(read_text(file), str(file))
    if suffix == ".tdms":
        try:
            from rig.foreign.tdms_file import read_tdms  # start-up: an optional package, only TDMS needs it
        except ImportError:
            raise RigInputError(f"{file}: reading TDMS needs npTDMS; pip install 'piano-action-rig[tdms]'") from None
        return read_tdms(file)
    if suffix in HDF5 or (suffix == ".mat" and file.is_file() and h5py.is_hdf5(file)):  # MATLAB 7.3
        return (read_hdf5(file),)
    if suffix == ".mat":
        return (read_mat(file),)
    raise RigInputError(f"{file}: ending {suffix!r}, allowed {', '.join(SUFFIXES)}; save the recording as one of them")


def read_channels(path: str | Path, *, separator: str = ",", decimal: str = ".") -> ChannelTable:
    """Read all channels of a recording of one segment, by the ending of its name (text, LVM, TDMS, HDF5, MATLAB);
    RigInputError for a file of several segments, or one that cannot be read.

    Parameters
    ----------
    path : path
        TDMS, LVM, CSV or HDF5 file.
    separator, decimal : str
        Of CSV.

    Returns
    -------
    ChannelTable
        Channels by name, each (n,), with units and clocks as far as the file states them.

    Raises
    ------
    RigInputError
        When the file cannot be read, or has several segments.

    Examples
    --------
    >>> import rig
    >>> rig.read_channels("lab.csv").channel("force_n").size
    5001
    """
    segments = read_segments(path, separator=separator, decimal=decimal)
    if len(segments) != 1:
        raise RigInputError(
            f"{path}: {len(segments)} segments, allowed 1 here; save the one that is meant to its own file"
        )
    return segments[0]


class UncorrectedForceError(RigInputError):
    """The ``force_n`` of an older export is the reading of the load cell, not the force that acted."""


def read_force(path: str | Path, column: str = "force_n") -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Read times, s, and the force ``column``, converted to N, (n,) each, of a recording of one segment; another column
    than ``force_n`` keeps its unit. Times must be even.

    Parameters
    ----------
    path : TDMS, LVM, CSV or HDF5 file
    column : channel of the force, or of what else drives a simulation. Times are the channel ``time_s`` or the file's
        clock.
    """
    table = read_channels(path)
    if column == "force_n" and "force_raw" in table.channels and "raw_force_n" not in table.channels:
        raise UncorrectedForceError(
            f"{path}: is an older export, its force_n is not corrected for offset, delay and hum; export it again"
        )
    unit = known_unit(table.units.get(column, "")) or "N"
    if column == "force_n" and unit not in NEWTONS:
        raise RigInputError(
            f"{path}: {column} is in {unit!r}, allowed {', '.join(NEWTONS)}; state the scale in a mapping"
        )
    values = table.channel(column) * (NEWTONS[unit] if column == "force_n" else 1.0)
    time_channel = "time_s" if "time_s" in table.channels or not table.clocks else None
    time_unit = known_unit(table.units.get("time_s", "")) or "s"
    if time_unit not in SECONDS:
        raise RigInputError(f"{path}: time_s is in {time_unit!r}, allowed {', '.join(SECONDS)}")
    interval_s = table.interval([column], time_channel, "a channel time_s", unit=time_unit)
    table.check_rate([column], interval_s, [time_channel] if time_channel else [])
    start_s = 0.0 if time_channel is None else float(table.channel(time_channel)[0]) * SECONDS[time_unit]
    return start_s + interval_s * np.arange(values.size, dtype=np.float64), values


def join_segments(segments: Sequence[ChannelTable], names: Sequence[str]) -> ChannelTable:
    """Join successive segments into one table of the channels ``names`` alone; RigInputError for another unit or rate,
    or where times do not go on from one to the next."""
    first = segments[0]
    whole = {name: np.concatenate([segment.channel(name) for segment in segments]) for name in names}
    for before, after in zip(segments, segments[1:], strict=False):
        for name in names:
            if before.units.get(name, "") != after.units.get(name, ""):
                raise RigInputError(
                    f"{after.where}: {name} is in {after.units.get(name, '')!r}, in the segment before it in "
                    f"{before.units.get(name, '')!r}; such segments cannot be joined"
                )
            if name not in before.clocks or name not in after.clocks:
                continue
            one, other = before.clocks[name], after.clocks[name]
            n = before.channel(name).size
            if abs(other.interval_s - one.interval_s) * n > 0.5 * one.interval_s:
                raise RigInputError(
                    f"{after.where}: a sample every {other.interval_s:g} s, in the segment before it every "
                    f"{one.interval_s:g} s; such segments cannot be joined"
                )
            later = other.start_s - one.start_s, other.stamp_s - one.stamp_s
            if later == (0.0, 0.0):
                continue  # times restart and no stamp is stated: the mapping decides
            # times run on from the first segment's stamp, or restart at each segment's own
            spans = [sum(later)] if later[0] == 0.0 else [later[0], sum(later)]
            gap = min((span - n * one.interval_s for span in spans), key=abs)
            if abs(gap) > 0.5 * one.interval_s:
                raise RigInputError(
                    f"{after.where}: {name} begins {gap:g} s after the end of the segment before it; samples are "
                    'missing, segments = "trials" keeps them apart'
                )
    clocks = {name: first.clocks[name] for name in names if name in first.clocks}
    where, cut_off = first.where.removesuffix(" segment 1"), segments[-1].cut_off
    computed = first.computed
    return ChannelTable(where, whole, first.units, clocks, computed=computed, cut_off=cut_off, started=first.started)
