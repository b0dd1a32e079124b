"""TDMS of LabVIEW and NI-DAQmx, by npTDMS (extra ``tdms``): every numeric channel, as ``channel`` or ``group/channel``.

Clocks are the waveform properties ``wf_increment``, ``wf_start_offset`` and ``wf_start_time``; a channel of time stamps
becomes seconds after its first. Scales of DAQmx and LabVIEW are applied by npTDMS. TDMS has no checksum: a file that
is cut off or whose sizes do not fit the file is refused, changed numbers cannot be noticed.
"""

from __future__ import annotations

import logging
import struct
import warnings
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable, Clock

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
