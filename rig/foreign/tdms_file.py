"""TDMS of LabVIEW and NI-DAQmx, by npTDMS (extra ``tdms``): every numeric channel, as ``channel`` or ``group/channel``.

The interval is ``wf_increment`` where all channels agree. TDMS has no checksum: a file that is cut off, whose
channels differ in length or whose sizes do not fit the file is refused, changed numbers cannot be noticed.
"""

from __future__ import annotations

import logging
import struct
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from rig.errors import InputError
from rig.foreign.channel_table import ChannelTable

_LEAD_IN = struct.Struct("<4sIIQQ")


class _Complaints(logging.Handler):
    """Keeps what npTDMS warns of."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep one line."""
        self.lines.append(record.getMessage())


def read_tdms(path: Path) -> ChannelTable:
    """Read all numeric channels of a TDMS file.

    Raises
    ------
    InputError
        When npTDMS is not installed, or the file is damaged, cut off or without numeric channels of one length.
    """
    try:
        from nptdms import TdmsFile, log
    except ImportError:
        raise InputError(f"{path}: reading TDMS needs npTDMS; pip install 'piano-action-rig[tdms]'") from None
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
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:  # a damaged file makes npTDMS raise nearly anything
        words = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise InputError(f"{path}: not a whole TDMS file ({words})") from None
    finally:
        logger.removeHandler(complaints)


def _check_segments(path: Path, size: int) -> None:
    """Refuse a file whose segments do not follow each other from its first byte to its last."""
    at = 0
    with path.open("rb") as stream:
        while at < size:
            stream.seek(at)
            lead = stream.read(_LEAD_IN.size)
            if len(lead) < _LEAD_IN.size or lead[:4] != b"TDSm":
                raise InputError(f"{path}: not a whole TDMS file (no segment at byte {at})")
            _, _, version, following, raw = _LEAD_IN.unpack(lead)
            at += _LEAD_IN.size + following
            if at > size or raw > following or version not in (4712, 4713):
                raise InputError(f"{path}: not a whole TDMS file (its last segment is cut off at byte {size})")
    if not size:
        raise InputError(f"{path}: is empty")


def _read(path: Path, file: object, size: int, complaints: _Complaints) -> ChannelTable:
    channels = [
        channel
        for group in file.groups()  # type: ignore[attr-defined]
        for channel in group.channels()
        if channel.dtype.kind in "iuf" and len(channel)
    ]
    if sum(len(channel) * channel.dtype.itemsize for channel in channels) > 16 * size:
        raise InputError(f"{path}: names more samples than its {size} bytes hold; the file is damaged")
    lengths = {f"{channel.group_name}/{channel.name}": len(channel) for channel in channels}
    if len(set(lengths.values())) != 1:
        found = ", ".join(f"{name} ({n})" for name, n in lengths.items()) or "none"
        raise InputError(f"{path}: numeric channels: {found}; allowed some of one equal length")
    short = Counter(channel.name for channel in channels)
    columns, units, intervals = {}, {}, set()
    for channel in channels:
        name = channel.name if short[channel.name] == 1 else f"{channel.group_name}/{channel.name}"
        columns[name] = np.asarray(channel[:], dtype=np.float64)
        units[name] = str(channel.properties.get("unit_string", ""))
        intervals.add(channel.properties.get("wf_increment"))
    if complaints.lines or len({values.size for values in columns.values()}) != 1:
        raise InputError(f"{path}: not a whole TDMS file ({(complaints.lines or ['cut off'])[0][:120]})")
    interval = intervals.pop() if len(intervals) == 1 else None
    known = isinstance(interval, float) and np.isfinite(interval) and interval > 0
    return ChannelTable(str(path), columns, {k: v for k, v in units.items() if v}, interval if known else None)
