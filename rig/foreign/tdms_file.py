"""TDMS of LabVIEW and NI-DAQmx, by npTDMS (extra ``tdms``): every numeric channel, as ``channel`` or ``group/channel``.

Clocks are the waveform properties ``wf_increment``, ``wf_start_offset`` and ``wf_start_time``, else a sample rate among
the properties of the channel, its group or the file; a channel of time stamps becomes seconds after its first. Scales
of DAQmx and LabVIEW are applied by npTDMS; one that it does not know is a doubt. Where a later segment states another
start, rate, unit or scale of a channel that has samples already, the file is several recordings, one table each: npTDMS
itself would give all samples the last statement. TDMS has no checksum: a file that is cut off or whose sizes do not fit
the file is refused, changed numbers cannot be noticed. A last segment without a size was not finalised; its whole
samples are read, and the table says so.
"""

from __future__ import annotations

import logging
import struct
import warnings
from collections import Counter
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from nptdms import TdmsFile, log
from nptdms.reader import TdmsReader

from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable, known_unit
from rig.foreign.sample_times import SECONDS, Clock
from rig.foreign.stated_properties import find_clock, find_scale_doubt, find_unit, is_unit_scale_or_time

_MARK = struct.Struct("<4sI")
_SIZES = {False: struct.Struct("<IQQ"), True: struct.Struct(">IQQ")}
_BIG_ENDIAN = 1 << 6  # bit of the table of contents, which itself is always little-endian
_NOT_FINALISED = 2**64 - 1
Properties = dict[str, dict[str, Any]]
"""Property values by path of the object and name."""


class _Complaints(logging.Handler):
    """Collects the warnings of npTDMS."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())

    def take(self) -> str:
        """Return the first line since the last call; empty where there is none."""
        lines, self.lines = self.lines, []
        return lines[0] if lines else ""


def read_tdms(path: Path) -> tuple[ChannelTable, ...]:
    """Read the numeric channels of a TDMS file, one table for each recording in it (a new one begins where unit, scale,
    rate or start is stated anew); RigInputError for a damaged file or none of numbers."""
    complaints = _Complaints()
    logger, console = logging.getLogger("nptdms"), log.log_manager.console_handler
    logger.addHandler(complaints)
    console.addFilter(_refuse_all)
    try:
        size = path.stat().st_size
        count, is_whole = _check_segments(path, size)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            # npTDMS leaves a file open that it fails to read
            with path.open("rb") as stream, ExitStack() as stack:
                parts = _find_recordings(stream, count, str(path))
                tables = []
                scales: Properties | None = None
                for number, part in enumerate(parts, 1):
                    if scales != part.scales:  # npTDMS keeps a scale once it has been used
                        complaints.take()
                        stream.seek(0)
                        file, scales = stack.enter_context(TdmsFile.open(stream)), part.scales
                        if (complaint := complaints.take()) and is_whole:
                            raise RigInputError(f"{path}: not a whole TDMS file ({complaint[:120]})")
                        channels = _numeric_channels(file, part, size, complaints, str(path))
                    where = str(path) if len(parts) == 1 else f"{path} segment {number}"
                    tables.append(_fill_table(ChannelTable(where, {}), channels, part, complaints))
            cut_off = "" if is_whole else "the program that recorded it did not finalise the file"
            return (*tables[:-1], replace(tables[-1], cut_off=cut_off))
    except RigInputError:
        raise
    except OSError as error:
        raise RigInputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:  # a damaged file makes npTDMS raise nearly anything
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        raise RigInputError(f"{path}: not a whole TDMS file ({reason})") from None
    finally:
        console.removeFilter(_refuse_all)
        logger.removeHandler(complaints)


def _refuse_all(record: logging.LogRecord) -> bool:
    return False


def _check_segments(path: Path, size: int) -> tuple[int, bool]:
    """Number of segments of a TDMS file of ``size`` bytes, and whether the last one was finalised (its length written);
    RigInputError where the file is cut off or damaged."""
    at = count = 0
    with path.open("rb") as stream:
        while at < size:
            stream.seek(at)
            lead = stream.read(_MARK.size + _SIZES[False].size)
            if len(lead) < _MARK.size + _SIZES[False].size or lead[:4] != b"TDSm":
                raise RigInputError(f"{path}: not a whole TDMS file (no segment at byte {at})")
            contents = _MARK.unpack_from(lead)[1]
            version, following, raw = _SIZES[bool(contents & _BIG_ENDIAN)].unpack_from(lead, _MARK.size)
            at, count = at + len(lead) + following, count + 1
            if following == _NOT_FINALISED and version in (4712, 4713):
                return count, False
            if at > size or raw > following or version not in (4712, 4713):
                raise RigInputError(f"{path}: not a whole TDMS file (its last segment is cut off at byte {size})")
    if not size:
        raise RigInputError(f"{path}: is empty")
    return count, True


class _Recording:
    """A recording within a file: its samples by path of the channel, from and to, and what is stated of them."""

    def __init__(self, first: dict[str, int], end: dict[str, int], stated: Properties) -> None:
        self.first, self.end, self.stated = first, end, stated
        self.scales: Properties = {
            name: {key: value for key, value in values.items() if "Scal" in key} for name, values in stated.items()
        }


def _find_recordings(stream: BinaryIO, segments: int, where: str) -> list[_Recording]:
    """Recordings within a TDMS file: a new one begins where a segment changes unit, scale, rate or start of a channel
    with samples; each with the range of samples and the properties by channel."""
    reader = TdmsReader(stream)
    history: list[tuple[dict[str, int], Mapping[str, Any]]] = []
    sizes: dict[str, int] = {}

    def note(properties: Mapping[str, Any] | None) -> None:
        nonlocal sizes
        history.append((sizes, properties or {}))
        sizes = {name: metadata.num_values for name, metadata in reader.object_metadata.items()}

    # npTDMS keeps the last value of a property only; there is no public way to those of each segment
    reader._update_object_properties = note
    reader.read_metadata()
    if len(history) not in (segments, segments - 1):  # of the last one the metadata may be cut off
        raise RigInputError(f"{where}: this version of npTDMS does not tell the segments; install the latest one")
    stated: Properties = {}
    parts: list[_Recording] = []
    first: dict[str, int] = {}
    for before, properties in history:
        new: Properties = {
            name: {key: value.as_datetime64() if hasattr(value, "as_datetime64") else value for key, value in pairs}
            for name, pairs in properties.items()
        }
        if before != first and any(
            is_unit_scale_or_time(key) and key in stated.get(name, {}) and stated[name][key] != value
            for name, values in new.items()
            for key, value in values.items()
        ):
            parts.append(_Recording(first, before, {name: dict(values) for name, values in stated.items()}))
            first = before
        for name, values in new.items():
            stated.setdefault(name, {}).update(values)
    return [*parts, _Recording(first, sizes, stated)]


def _numeric_channels(
    file: Any, part: _Recording, size: int, complaints: _Complaints, where: str
) -> dict[str, tuple[Any, str]]:
    """npTDMS's channel, and its warning about an unknown scale (or empty), of each numeric channel by name; gives all
    objects of ``file`` the properties of ``part``, by which npTDMS scales."""
    channels = [channel for group in file.groups() for channel in group.channels() if len(channel)]
    for node in (file, *file.groups(), *channels):
        # npTDMS applies the scales that an object's properties state
        node.properties.clear()
        node.properties.update(part.stated.get(getattr(node, "path", "/"), {}))
    numeric = []
    for channel in channels:
        kind = channel.dtype.kind  # takes its scale, and complains of one that is not known
        complaint = complaints.take()
        if kind in "iufM":
            numeric.append((channel, complaint))
    if not numeric:
        raise RigInputError(f"{where}: no numeric channel")
    if sum(len(channel) * channel.dtype.itemsize for channel, _ in numeric) > 16 * size:
        raise RigInputError(f"{where}: names more samples than its {size} bytes hold; the file is damaged")
    short = Counter(channel.name for channel, _ in numeric)
    return {c.name if short[c.name] == 1 else f"{c.group_name}/{c.name}": (c, text) for c, text in numeric}


def _fill_table(
    table: ChannelTable, channels: dict[str, tuple[Any, str]], part: _Recording, complaints: _Complaints
) -> ChannelTable:
    """Return the table with the samples of recording ``part``, as float64, with units, clocks, start and doubts of its
    channels (as `_numeric_channels` gives them); time stamps become s after the first."""
    columns, started = {}, ""
    doubts: dict[str, str] = {}
    units: dict[str, str] = {}
    clocks: dict[str, Clock] = {}
    for name, (channel, unscaled) in channels.items():
        first, end = part.first.get(channel.path, 0), part.end.get(channel.path, 0)
        if first == end:
            continue
        values = channel[first:end]
        if len(values) != end - first:
            raise RigInputError(f"{table.where}: not a whole TDMS file ({name} is cut off)")
        stated, is_stamp = part.stated.get(channel.path, {}), values.dtype.kind == "M"
        columns[name] = (
            (values - values[0]) / np.timedelta64(1, "ns") * 1e-9 if is_stamp else np.asarray(values, dtype=np.float64)
        )
        unit, doubt = ("s", "") if is_stamp else find_unit(stated)
        units |= {name: unit} if unit else {}
        outer = [part.stated.get(path, {}) for path in (channel.path.partition("'/'")[0] + "'", "/")]
        doubt = doubt or find_scale_doubt(stated)
        doubts |= {name: f"{name}: {doubt}"} if doubt else {}
        if complaint := complaints.take():
            raise RigInputError(f"{table.where}: not a whole TDMS file ({complaint[:120]})")
        if unscaled:
            doubts[name] = f"{name}: {unscaled[:120]}; overrule_units in the mapping takes its numbers as they are"
        try:
            clock = _waveform_clock(stated) or find_clock(stated, *outer)
        except ValueError as error:
            doubts[name] = f"{name}: {error}"
        else:
            clocks |= {name: clock} if clock else {}
        begun = values[0] if is_stamp else stated.get("wf_start_time")
        if not started and isinstance(begun, np.datetime64) and not np.isnat(begun):
            started = f"{begun.astype('datetime64[us]')}+00:00"  # TDMS keeps times in UTC
    return replace(table, channels=columns, units=units, clocks=clocks, doubts=doubts, started=started)


def _waveform_clock(properties: Mapping[str, object]) -> Clock | None:
    """Clock, s, by the waveform properties ``wf_increment``, ``wf_start_offset``, ``wf_start_time``; None without a
    positive increment, ValueError where its unit is not one of time."""
    interval, offset = properties.get("wf_increment"), properties.get("wf_start_offset", 0.0)
    if not isinstance(interval, float | int) or not (np.isfinite(interval) and interval > 0):
        return None
    unit = known_unit(str(properties.get("wf_xunit_string", ""))) or "s"
    if unit not in SECONDS:
        raise ValueError(f"wf_xunit_string = {unit!r}, allowed {', '.join(SECONDS)}: the samples are not over time")
    start = float(offset) if isinstance(offset, float | int) and np.isfinite(offset) else 0.0
    begun = properties.get("wf_start_time")
    stamp = begun.astype("datetime64[ns]").astype(np.int64) * 1e-9 if isinstance(begun, np.datetime64) else 0.0
    return Clock(float(interval) * SECONDS[unit], start * SECONDS[unit], float(stamp), source="wf_increment")
