"""Choosing the reader by the extension of a file's name, and joining the segments of a file.

Segments are joined only where the file's own times continue from one to the next, or where it states none.

HDF5: a sealed trial of a session, or any file with one-dimensional datasets of numbers (``name``, ``group/name``).
A trial gives ``force_n`` (less its mean before the blow), ``motor_command_v`` and the angles in rad; its seal is
checked first. Other files carry no checksum: what the HDF5 library cannot read is refused. A dataset's attribute
``units`` is its unit.

TDMS of LabVIEW and NI-DAQmx, by npTDMS (extra ``tdms``): every numeric channel, as ``channel`` or ``group/channel``.
Clocks are the waveform properties ``wf_increment``, ``wf_start_offset`` and ``wf_start_time``; a channel of time stamps
becomes seconds after its first. Scales of DAQmx and LabVIEW are applied by npTDMS. TDMS has no checksum: a file that
is cut off or whose sizes do not fit the file is refused, changed numbers cannot be noticed.
"""

from __future__ import annotations

import logging
import struct
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np

from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable, Clock
from rig.foreign.csv_text import read_csv
from rig.foreign.lvm_text import read_lvm
from rig.session.trial_file import SCHEMA, read_trial


def read_hdf5(path: Path) -> ChannelTable:
    """Read the channels of a trial or of a plain HDF5 file.

    Raises RigInputError when the file cannot be read or has no numbers.
    """
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("schema") != SCHEMA:
                return _plain(path, file)
    except RigInputError:
        raise
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        raise RigInputError(f"{path}: not a readable HDF5 file ({' '.join(str(error).split())[:120]})") from None
    data = read_trial(path)
    no_force = not data.has_force
    before = data.time_s < data.blow_start_s
    baseline_n = float(data.force_n[before].mean()) if before.any() else 0.0
    angles = {f"{e.name}_rad": data.angle_rad()[:, i] for i, e in enumerate(data.encoders)}
    further = {}
    if no_force and data.channel_values is not None:
        further = {info.name: data.channel_values[:, k] for k, info in enumerate(data.channels)}
    force = {} if no_force else {"force_n": data.force_n - baseline_n}
    columns = {"time_s": data.time_s, **force, "motor_command_v": data.motor_command_v, **angles, **further}
    clock = Clock(1.0 / data.sample_rate_hz)
    units = {"time_s": "s", "force_n": "N", "motor_command_v": "V", **dict.fromkeys(angles, "rad")}
    return ChannelTable(str(path), columns, units, dict.fromkeys(columns, clock), started=data.started_utc)


def _plain(path: Path, file: h5py.File) -> ChannelTable:
    columns, units = {}, {}

    def take(name: str, node: h5py.Group | h5py.Dataset) -> None:
        if isinstance(node, h5py.Dataset) and node.ndim == 1 and node.dtype.kind in "iuf" and node.size:
            columns[name] = np.asarray(node[()], dtype=np.float64)
            stated = node.attrs.get("units", b"")
            units[name] = stated.decode("utf-8", "replace") if isinstance(stated, bytes) else str(stated)

    file.visititems(take)
    if not columns:
        raise RigInputError(f"{path}: no one-dimensional dataset of numbers")
    return ChannelTable(str(path), columns, {name: unit for name, unit in units.items() if unit})


_MARK = struct.Struct("<4sI")
_SIZES = {False: struct.Struct("<IQQ"), True: struct.Struct(">IQQ")}
_BIG_ENDIAN = 1 << 6
"""Bit of the table of contents, which itself is always little-endian."""


class _Complaints(logging.Handler):
    """Collects the warnings of npTDMS."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Store one line."""
        self.lines.append(record.getMessage())


def read_tdms(path: Path) -> ChannelTable:
    """Read all numeric channels of a TDMS file.

    Raises RigInputError when npTDMS is not installed, or the file is damaged, cut off or without numeric channels of
    one length.
    """
    try:
        from nptdms import TdmsFile, log  # start-up: an optional package, only TDMS needs it
    except ImportError:
        raise RigInputError(f"{path}: reading TDMS needs npTDMS; pip install 'piano-action-rig[tdms]'") from None
    complaints = _Complaints()
    log.log_manager.set_level(logging.ERROR)
    logger = logging.getLogger("nptdms")
    logger.addHandler(complaints)
    try:
        size = path.stat().st_size
        _check_segments(path, size)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # npTDMS leaves a file open that it fails to read
            with path.open("rb") as stream, TdmsFile.open(stream) as file:
                return _read(path, file, size, complaints)
    except RigInputError:
        raise
    except OSError as error:
        raise RigInputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:  # a damaged file makes npTDMS raise nearly anything
        words = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise RigInputError(f"{path}: not a whole TDMS file ({words})") from None
    finally:
        logger.removeHandler(complaints)


def _check_segments(path: Path, size: int) -> None:
    """Refuse a file whose segments do not follow each other from its first byte to its last."""
    at = 0
    with path.open("rb") as stream:
        while at < size:
            stream.seek(at)
            lead = stream.read(_MARK.size + _SIZES[False].size)
            if len(lead) < _MARK.size + _SIZES[False].size or lead[:4] != b"TDSm":
                raise RigInputError(f"{path}: not a whole TDMS file (no segment at byte {at})")
            contents = _MARK.unpack_from(lead)[1]
            version, following, raw = _SIZES[bool(contents & _BIG_ENDIAN)].unpack_from(lead, _MARK.size)
            at += len(lead) + following
            if at > size or raw > following or version not in (4712, 4713):
                raise RigInputError(f"{path}: not a whole TDMS file (its last segment is cut off at byte {size})")
    if not size:
        raise RigInputError(f"{path}: is empty")


def _read(path: Path, file: object, size: int, complaints: _Complaints) -> ChannelTable:
    channels = [
        channel
        for group in file.groups()  # type: ignore[attr-defined]
        for channel in group.channels()
        if channel.dtype.kind in "iufM" and len(channel)
    ]
    if not channels:
        raise RigInputError(f"{path}: no numeric channel")
    if sum(len(channel) * channel.dtype.itemsize for channel in channels) > 16 * size:
        raise RigInputError(f"{path}: names more samples than its {size} bytes hold; the file is damaged")
    short = Counter(channel.name for channel in channels)
    columns, units, clocks, started = {}, {}, {}, ""
    for channel in channels:
        name = channel.name if short[channel.name] == 1 else f"{channel.group_name}/{channel.name}"
        values = channel[:]
        if len(values) != len(channel):
            raise RigInputError(f"{path}: not a whole TDMS file ({name} is cut off)")
        stamps = channel.dtype.kind == "M"
        columns[name] = (
            (values - values[0]) / np.timedelta64(1, "ns") * 1e-9 if stamps else np.asarray(values, dtype=np.float64)
        )
        units[name] = "s" if stamps else str(channel.properties.get("unit_string", ""))
        if (clock := _clock(channel.properties)) is not None:
            clocks[name] = clock
        begun = values[0] if stamps else channel.properties.get("wf_start_time")
        if not started and isinstance(begun, np.datetime64) and not np.isnat(begun):
            started = f"{begun.astype('datetime64[us]')}+00:00"  # TDMS keeps times in UTC
    if complaints.lines:
        raise RigInputError(f"{path}: not a whole TDMS file ({complaints.lines[0][:120]})")
    return ChannelTable(str(path), columns, {k: v for k, v in units.items() if v}, clocks, started=started)


def _clock(properties: Mapping[str, object]) -> Clock | None:
    """Clock by the waveform properties; None where the increment is not stated."""
    interval, offset = properties.get("wf_increment"), properties.get("wf_start_offset", 0.0)
    if not isinstance(interval, float | int) or not (np.isfinite(interval) and interval > 0):
        return None
    start = float(offset) if isinstance(offset, float | int) and np.isfinite(offset) else 0.0
    begun = properties.get("wf_start_time")
    stamp = begun.astype("datetime64[ns]").astype(np.int64) * 1e-9 if isinstance(begun, np.datetime64) else 0.0
    return Clock(float(interval), start, float(stamp))


SUFFIXES = (".csv", ".csv.gz", ".txt", ".lvm", ".tdms", ".h5", ".hdf5")


def read_segments(
    path: str | Path, *, separator: str = ",", decimal: str = ".", thousands: str = ""
) -> tuple[ChannelTable, ...]:
    """Read all channels of a recording, one table a segment; the signs are for CSV only.

    Raises RigInputError when the ending is not known or the file cannot be used.
    """
    file = Path(path)
    suffix = "".join(file.suffixes[-2:]).lower() if file.suffix.lower() == ".gz" else file.suffix.lower()
    if suffix in (".csv", ".txt", ".csv.gz", ".txt.gz"):
        return (read_csv(file, separator, decimal, thousands),)
    if suffix == ".lvm":
        return read_lvm(file)
    if suffix == ".tdms":
        return (read_tdms(file),)
    if suffix in (".h5", ".hdf5"):
        return (read_hdf5(file),)
    raise RigInputError(f"{file}: ending {suffix!r}, allowed {', '.join(SUFFIXES)}")


def read_channels(path: str | Path, *, separator: str = ",", decimal: str = ".") -> ChannelTable:
    """Read a recording of one segment.

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


def joined(segments: Sequence[ChannelTable], names: Sequence[str]) -> ChannelTable:
    """Return segments as one table with the channels ``names``.

    Raises RigInputError when a channel is not in all of them, has several units or intervals, or time is missing
    between them.
    """
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
    return ChannelTable(first.where.removesuffix(" segment 1"), whole, first.units, clocks, started=first.started)
