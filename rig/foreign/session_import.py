"""Foreign recordings made into a session: one file, one trial; all are read and checked before anything is written.

A recording of positions is one long table cut into strokes, without force and encoders. The readings are kept as they
were, after offset and gain; the displacement follows from the ruler points in every trial file. A saturated sensor is
refused; a stroke that is not whole, because the recording begins or ends with it, becomes a trial with the status
``incomplete``. Levels of rest are those before each stroke: optical sensors drift.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.atomic_write import sha256_of_bytes, sha256_of_file
from rig.configuration.rig_file import BODIES, LimitsConfig
from rig.errors import RigInputError
from rig.foreign.channel_table import ChannelTable
from rig.foreign.mapping import EncoderMapping, ImportMapping, MappingFile, PositionMapping, check_unit
from rig.foreign.reading import join_segments, read_segments
from rig.foreign.sample_times import SECONDS, BrokenTimes, typical_interval
from rig.safety.interlocks import SPEED_OVER_S, SUSTAINED_S
from rig.session import Session, SessionInfo
from rig.session.annotation_file import utc_now
from rig.session.force_correction import MINIMUM_QUIET_S, ONSET_SAMPLES, ONSET_SHARE, ONSET_SIGMA
from rig.session.info import (
    MAPPING,
    NO_FORCE,
    ChannelInfo,
    EncoderInfo,
    FileInfo,
    ForceInfo,
    PlanInfo,
    RulerInfo,
    take_same_fields,
)
from rig.session.ruler import position_of
from rig.session.trial_data import TrialData

Array = NDArray[np.float64]

FIRST_S = 0.01  # of rest that tells when the first stroke leaves it, where that is within the time kept before one


@dataclass(frozen=True)
class Cut:
    """A stroke: samples ``first`` to ``end``, ``trigger`` the first beyond the level; ``cut_off`` is empty or says why
    it is not whole."""

    first: int
    trigger: int
    end: int
    cut_off: str = ""


def cut_strokes(
    displacement: Array, travel: Array, rate_hz: float, *, trigger: float, pre_s: float, rest_s: float
) -> list[Cut]:
    """Find the strokes in displacements (n, k), m, of k sensors: each from a departure by ``trigger`` (share of
    ``travel``) from the level of rest until all are back, with ``pre_s`` before and ``rest_s`` of rest after.

    Parameters
    ----------
    displacement : (n, k), of k sensors, m
    travel : (k,), length of each one's ruler, m
    trigger : departure from the level of rest that begins a stroke, as a share of the travel
    pre_s, rest_s : time kept before, and how long all must be back at the end, s. Strokes with less than ``rest_s`` and
        half of ``pre_s`` between them are one trial: the second would have no rest to begin from.
    """
    share = displacement / travel
    pre = max(int(pre_s * rate_hz), 1)
    level = np.median(share[: max(round(FIRST_S * rate_hz), 1)], axis=0)
    if not np.any(np.abs(share[:pre] - level) > trigger):
        level = np.median(share[:pre], axis=0)
    if np.any(level > trigger):  # begins within a stroke: rest is where the sensors are lowest
        level = np.percentile(share, 2.0, axis=0)
    away = np.any(np.abs(share - level) > trigger, axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], away, [False]]).astype(np.int8)))
    runs = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    joined: list[list[int]] = []
    for begin, end in runs:
        if joined and begin - joined[-1][1] < (rest_s + pre_s / 2) * rate_hz:
            joined[-1][1] = end
        elif end - begin >= SUSTAINED_S * rate_hz or joined and begin == joined[-1][1]:
            joined.append([begin, end])
    cuts = []
    pre, rest = round(pre_s * rate_hz), round(rest_s * rate_hz)
    for k, (begin, end) in enumerate(joined):
        before = joined[k - 1][1] if k else 0
        after = joined[k + 1][0] if k + 1 < len(joined) else len(share)
        first = max(begin - pre, (before + rest) if k else 0, 0)
        reason = ""
        if end + rest > len(share):
            reason = "the recording ends during this stroke"
        elif begin < SUSTAINED_S * rate_hz:
            reason = "the recording begins during this stroke"
        cuts.append(Cut(min(first, begin), begin, min(end + rest, after, len(share)), reason))
    return cuts


SATURATED = 3  # samples in a row at an end of the converter: no peak has as many equal ones


def cut_position_trials(
    table: ChannelTable, mapping: ImportMapping, interval_s: float, first_number: int, started_utc: str
) -> list[tuple[TrialData, str]]:
    """Cut a recording of positions into trials, a stroke each, numbered from ``first_number``; with each the reason to
    reject it that the mapping states, empty for none. RigInputError where no stroke is found."""
    infos = tuple(make_channel_info(one) for one in mapping.positions)
    values = np.column_stack([_read_position(table, one, mapping.overrule_units) for one in mapping.positions])
    time_s = np.arange(len(values), dtype=np.float64) * interval_s
    found = [
        position_of(info.name, info.ruler, time_s, values[:, k], info.u_noise)
        for k, info in enumerate(infos)
        if info.ruler is not None
    ]
    rule = mapping.strokes
    cuts = cut_strokes(
        np.column_stack([one.displacement_m for one in found]), np.array([one.travel_m for one in found]),
        1.0 / interval_s, trigger=rule.trigger, pre_s=rule.pre_s, rest_s=rule.rest_s,
    )  # fmt: skip
    if not cuts:
        raise RigInputError(
            f"{table.where}: no stroke found; no position leaves its rest by {rule.trigger:g} of its ruler "
            "(strokes.trigger in the mapping)"
        )
    origin = _first_time(table, mapping), Path(table.where).name.removesuffix(".gz")
    return [
        _make_position_trial(mapping, infos, values, cut, interval_s, first_number + k, started_utc, origin)
        for k, cut in enumerate(cuts)
    ]


def make_channel_info(one: PositionMapping) -> ChannelInfo:
    """Description of a position sensor for a trial's file, from its table in the mapping: unit 1, value and reading by
    offset and gain, ruler points."""
    return ChannelInfo(
        name=one.name,
        quantity=f"reading of the position sensor at: {one.ruler.sensor_at}",
        unit="1",
        sensor=one.sensor,
        calibration=f"ruler at: {one.ruler.calibrated_at}",
        electrical=(one.offset, one.offset + one.gain),
        physical=(0.0, 1.0),
        channel=one.channel,
        group_delay_s=one.group_delay_s,
        u_noise=one.u_noise,
        ruler=RulerInfo(**one.ruler.model_dump()),
    )


def _read_position(table: ChannelTable, one: PositionMapping, overruled: tuple[str, ...]) -> Array:
    """Reading (n,) of a position sensor: (value - offset) / gain; refuse one that stays at the converter's limit, and
    one whose file states another unit unless its channel is in ``overruled``."""
    check_unit(table, one.channel, one.unit, overruled)
    raw = table.channel(one.channel)
    if one.limits is not None:
        for limit, at in ((one.limits[0], raw <= one.limits[0]), (one.limits[1], raw >= one.limits[1])):
            runs = np.convolve(at, np.ones(SATURATED, dtype=int), "valid") == SATURATED
            if runs.any():
                raise RigInputError(
                    f"{table.where}: {one.channel} row {int(np.argmax(runs)) + 1}: sensor saturated, {SATURATED} "
                    f"samples or more at the converter's limit {limit:g}; lower its gain, or leave this part out"
                )
    return (raw - one.offset) / one.gain


def _first_time(table: ChannelTable, mapping: ImportMapping) -> float:
    """First time of the recording by its own clock, s; 0 where it has none."""
    name = mapping.time.channel
    if name is not None and name in table.channels:
        return float(table.channel(name)[0]) * SECONDS[mapping.time.unit]
    return 0.0


def _make_position_trial(
    mapping: ImportMapping,
    infos: tuple[ChannelInfo, ...],
    values: Array,
    cut: Cut,
    interval_s: float,
    number: int,
    started_utc: str,
    origin: tuple[float, str],
) -> tuple[TrialData, str]:
    """Trial of the stroke ``cut`` and the mapping's reason to reject it, or empty; ``values`` (n, channels): readings
    of the whole recording; ``origin``: time of its first sample, s, and its file's name."""
    n = cut.end - cut.first
    origin_s, file = origin
    start_s = origin_s + cut.first * interval_s
    middle = origin_s + cut.trigger * interval_s
    inside = [one for one in mapping.strokes.episodes if one.file in ("", file) and one.from_s <= middle < one.to_s]
    missing = np.full(n, np.nan)
    data = TrialData(
        number=number,
        status="incomplete" if cut.cut_off else "complete",
        reason=cut.cut_off,
        started_utc=started_utc,
        simulated=mapping.simulated,
        sample_rate_hz=1.0 / interval_s,
        time_s=np.arange(n, dtype=np.float64) * interval_s,
        raw_force_n=missing,
        force_raw=missing,
        motor_command_v=missing,
        encoder_count=np.empty((n, 0), dtype=np.int64),
        encoders=(),
        force_info=NO_FORCE,
        blow_start_s=(cut.trigger - cut.first) * interval_s,
        condition=next((one.condition for one in inside if one.condition), ""),
        channels=infos,
        channel_values=values[cut.first : cut.end],
        provenance={
            "source_start_s": f"{start_s:.6f}",
            "source_end_s": f"{start_s + n * interval_s:.6f}",
            "mains_frequency_hz": f"{mapping.mains_frequency_hz:g}",
        },
    )
    return data, next((one.reject for one in inside if one.reject), "")


RATES_HZ = (100.0, 1e6)  # at which a blow can have been recorded; others mean a wrong unit of time


def sample_interval(table: ChannelTable, mapping: ImportMapping) -> float:
    """Return the interval of the samples, s, by the mapping or the file."""
    try:
        return _agreed_interval(table, mapping)
    except BrokenTimes as error:
        ignore = "" if mapping.time.channel else "; time.ignore leaves a column out that is no sample clock"
        raise RigInputError(f'{error}; segments = "trials" in the mapping cuts the recording there{ignore}') from None


def _agreed_interval(table: ChannelTable, mapping: ImportMapping) -> float:
    """Sampling interval, s, of the mapped channels, by the mapping or the file; RigInputError where times, units or
    rates contradict it, or it lies outside 100 Hz to 1 MHz."""
    time = mapping.time
    time_channel = time.channel if time.channel in table.channels or not table.clocks else None
    if time_channel is not None:
        check_unit(table, time_channel, time.unit, mapping.overrule_units)
    names = mapping.channels
    if time.sample_rate_hz is None:
        interval_s = table.interval(
            names, time_channel, "time.sample_rate_hz in the mapping", unit=time.unit, same_start=time.same_start
        )
        clock = table.stated_clock(names)
        if time_channel is None and clock is not None and clock.is_rounded:
            known = 0.5 * clock.resolution_s / interval_s
            raise RigInputError(
                f"{table.where}: the interval {interval_s:g} s is rounded to {clock.resolution_s:g} s: its rate is "
                f"known to {100 * known:.2g} % only; give time.sample_rate_hz in the mapping"
            )
    else:
        table.check_together(names, time.same_start)
        interval_s = 1.0 / time.sample_rate_hz
    table.check_rate(names, interval_s, [*time.ignore, *([time_channel] if time_channel else [])])
    rate_hz = 1.0 / interval_s
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise RigInputError(
            f"{table.where}: sampled at {rate_hz:g} Hz, allowed {RATES_HZ[0]:g} to {RATES_HZ[1]:g} Hz; look at the "
            "unit of the times (time.unit in the mapping)"
        )
    return interval_s


REST_SHARE = 0.1  # of a push or a pull, within which the rest before it lies: more is no rest
LARGEST_COUNT = 2.0**53
LARGEST_TURN_RAD = np.pi
"""No part of an action turns this far; a larger angle means a wrong unit or scale."""


def import_session(out: str | Path, files: Sequence[Path], mapping: MappingFile) -> Session:
    """Make a session folder ``out`` of foreign recordings, trial 1, 2, … in the order of ``files``, their channels as
    the mapping says; RigInputError, and nothing is left, where one cannot be used.

    Parameters
    ----------
    out : path
        Session folder to create.
    files : sequence of path
        Trial 1, 2, … in this order.
    mapping : MappingFile
        Which channel is what.

    Returns
    -------
    Session

    Raises
    ------
    RigInputError
        When a file cannot be used or the folder not be created; nothing is left behind then.

    Examples
    --------
    >>> from pathlib import Path
    >>> import rig
    >>> session = rig.import_session("sessions/from_lab", [Path("lab.csv")], rig.load_mapping("lab.toml"))
    >>> session.trial(1).read().status
    'complete'
    """
    if not files:
        raise RigInputError("no recording to import")
    config = mapping.config
    trials: list[TrialData] = []
    rejected: dict[int, str] = {}
    notes = {}
    for file in files:
        digest = sha256_of_file(file) if file.is_file() else ""
        tables = _read_recordings(file, config)
        for part, table in enumerate(tables, 1):
            segment = f" segment {part} of {len(tables)}" if len(tables) > 1 else ""
            started, first = _recording_start(table, file, config), len(trials) + 1
            if config.positions:
                cut = cut_position_trials(table, config, sample_interval(table, config), first, started)
                trials += [trial for trial, _ in cut]
                rejected |= {trial.number: reason for trial, reason in cut if reason}
            else:
                trials.append(trial := make_trial(table, config, first, started))
                if beyond := values_beyond_limits(trial, config.limits):
                    notes[f"limits of trial {first}"] = beyond
            for trial in trials[first - 1 :]:
                if not table.started:
                    notes[f"start of trial {trial.number}"] = "not stated by the file; its last change is taken"
                elif datetime.fromisoformat(trial.started_utc).tzinfo is None:
                    notes[f"start of trial {trial.number}"] = "local time, its zone is not stated"
                within = trial.provenance
                span = f" from {within['source_start_s']} to {within['source_end_s']} s" if within else ""
                notes[f"trial {trial.number}"] = f"{file.name}{segment}{span} sha256 {digest}"
    if config.segments == "join":
        notes["segments"] = "joined, one trial a file"
    if config.absent_encoders:
        notes["absent encoders"] = ", ".join(config.absent_encoders)
    if config.positions:
        notes["force"] = "not recorded"
    elif config.blow_start_s is None:
        notes["blow start"] = "found in the force, not recorded"
    digest = sha256_of_bytes(mapping.text.encode("utf-8"))
    info = SessionInfo(
        name=Path(out).name,
        operator=config.operator,
        created_utc=utc_now(),
        simulated=config.simulated,
        action=config.action,
        rig=FileInfo(name="imported", copy_name=MAPPING, sha256=digest),
        profile=FileInfo(name="unknown"),
        plan=PlanInfo(trials=len(trials)),
        room=config.room,
        backend={"name": "import"},
        notes=notes,
    )
    session = Session.create(out, info, {MAPPING: mapping.text})
    try:
        for trial in trials:
            session.add_trial(trial)
        for number, reason in rejected.items():
            session.annotate(number, "reject", reason, author="import")
    except BaseException:
        shutil.rmtree(session.path, ignore_errors=True)
        raise
    return session


def read_recording(path: Path, mapping: MappingFile) -> TrialData:
    """Return a foreign recording of one blow as trial 1 that its import would give; nothing is written. RigInputError
    where it cannot be used or holds several trials.

    Parameters
    ----------
    path : path
    mapping : MappingFile
        With a force.

    Returns
    -------
    TrialData
        Trial 1, of no session.

    Raises
    ------
    RigInputError
        When the recording cannot be used, or holds several trials.

    Examples
    --------
    >>> from pathlib import Path
    >>> import rig
    >>> rig.read_recording(Path("lab.csv"), rig.load_mapping("lab.toml")).has_force
    True
    """
    tables = _read_recordings(path, mapping.config)
    if len(tables) != 1:
        raise RigInputError(f"{path}: holds {len(tables)} trials, allowed one here; import it and give a trial")
    return make_trial(tables[0], mapping.config, 1, _recording_start(tables[0], path, mapping.config))


def _read_recordings(file: Path, config: ImportMapping) -> tuple[ChannelTable, ...]:
    """Read a file as one table a trial: its segments, split at breaks of the times, are trials each, or are joined, as
    the mapping says; RigInputError where it does not say what several are."""
    segments = read_segments(
        file, separator=config.separator, decimal=config.decimal, thousands=config.thousands,
        names_row=config.names_row, skip_rows=config.skip_rows,
    )  # fmt: skip
    segments = tuple(table.overrule(config.overrule_units, config.time.ignore) for table in segments)
    segments = tuple(_trim_to_shortest(table, config) for table in segments)
    if config.segments == "trials":
        return tuple(piece for table in segments for piece in _split_at_breaks(table, config))
    if len(segments) == 1:
        return segments
    if config.segments is None:
        raise RigInputError(
            f'{file}: {len(segments)} segments; say in the mapping what they are: segments = "trials" or "join"'
            + _describe_difference(segments[0], segments[1], config.channels)
        )
    for table in segments:
        sample_interval(table, config)
    names = config.channels
    timed = all(name in segment.clocks for segment in segments for name in names)
    return (join_segments(segments, names if timed or config.time.channel is None else [*names, config.time.channel]),)


def _describe_difference(one: ChannelTable, other: ChannelTable, names: Sequence[str]) -> str:
    """Return in words, in brackets, how unit, rate or start of a channel in ``names`` differs between two segments: the
    first difference, or empty."""
    for name in names:
        units = one.units.get(name, ""), other.units.get(name, "")
        clocks = one.clocks.get(name), other.clocks.get(name)
        if units[0] != units[1]:
            return f" ({name} is in {units[0]!r}, then in {units[1]!r})"
        if clocks[0] is None or clocks[1] is None:
            continue
        if clocks[0].interval_s != clocks[1].interval_s:
            return f" ({name} has a sample every {clocks[0].interval_s:g} s, then every {clocks[1].interval_s:g} s)"
        later_s = clocks[1].start_s - clocks[0].start_s + clocks[1].stamp_s - clocks[0].stamp_s
        if later_s:
            return f" ({name} begins {later_s:g} s later)"
    return ""


def _trim_to_shortest(table: ChannelTable, config: ImportMapping) -> ChannelTable:
    """Return a table that is not whole with its used channels as long as the shortest of them."""
    if not table.cut_off:
        return table
    used = [name for name in (*config.channels, config.time.channel or "") if name in table.channels]
    end = min((table.channels[name].size for name in used), default=0)
    return replace(table, channels={**table.channels, **{name: table.channels[name][:end] for name in used}})


def _split_at_breaks(table: ChannelTable, config: ImportMapping) -> list[ChannelTable]:
    """Pieces of a table between breaks of its times (the mapping's channel, or a column that tells them); the table
    itself where it has none."""
    time, names, clock = config.time, config.channels, table.stated_clock(config.channels)
    stated_s = 1.0 / time.sample_rate_hz if time.sample_rate_hz else clock.interval_s if clock else np.nan
    if time.channel is not None and time.channel in table.channels:
        columns = [table.channel(time.channel) * SECONDS[time.unit]]
    else:
        columns = [*table.time_columns(names, stated_s, time.ignore).values()]
    if not columns or columns[0].size < 2:
        return [table]
    interval_s = typical_interval(columns[0]) if np.isnan(stated_s) else stated_s
    return table.split_at_breaks(columns[0], interval_s) if interval_s > 0 else [table]


def _recording_start(table: ChannelTable, file: Path, config: ImportMapping) -> str:
    """When a recording began, ISO 8601, by the file's own statement (UTC; without a zone where that is not known), else
    when the file was last changed."""
    if table.started:
        started = datetime.fromisoformat(table.started)
        if started.tzinfo is None and config.utc_offset_h is not None:
            started = started.replace(tzinfo=timezone(timedelta(hours=config.utc_offset_h)))
        return started.isoformat() if started.tzinfo is None else started.astimezone(UTC).isoformat()
    return datetime.fromtimestamp(file.stat().st_mtime, UTC).isoformat(timespec="seconds")


def make_trial(table: ChannelTable, mapping: ImportMapping, number: int, started_utc: str = "") -> TrialData:
    """Trial of one recorded blow: force converted to N (not corrected for its offset), counts to whole numbers, times
    from 0, the blow's start by the mapping or found in the force; RigInputError where it cannot be used."""
    cell = mapping.force
    if cell is None:
        raise RigInputError(f"{table.where}: the mapping has no [force]; a recording of positions is cut into strokes")
    if cell.channel == "force_n" and "raw_force_n" in table.channels:
        raise RigInputError(f"{table.where}: force_n of an exported trial is corrected already; import raw_force_n")
    check_unit(table, cell.channel, cell.unit, mapping.overrule_units)
    raw = table.channel(cell.channel)
    interval_s = sample_interval(table, mapping)
    rate_hz = 1.0 / interval_s
    force = (raw - cell.zero) * cell.scale
    _check_pushes(force, interval_s, f"{table.where}: {cell.channel}")
    counts = np.empty((raw.size, len(mapping.encoders)), dtype=np.int64)
    for k, encoder in enumerate(mapping.encoders):
        counts[:, k] = _read_counts(table, encoder, mapping.overrule_units)
    volts = np.full(raw.size, np.nan)
    if mapping.motor is not None:
        volts = table.channel(mapping.motor.channel) * mapping.motor.volts_per_unit
        if mapping.motor.volts_per_unit == 1.0:
            check_unit(table, mapping.motor.channel, "V", mapping.overrule_units)
    start_s = mapping.blow_start_s
    reason = table.cut_off if "piece" not in table.cut_off else ""
    if start_s is None:
        try:
            start_s = find_start(force, interval_s, table.where)
        except RigInputError:
            if not table.cut_off:
                raise
            start_s, reason = 0.0, table.cut_off
    elif not start_s < raw.size * interval_s:
        raise RigInputError(f"{table.where}: blow_start_s = {start_s:g} s, allowed below {raw.size * interval_s:g} s")
    encoders = tuple(
        EncoderInfo(e.name, e.counts_per_revolution, e.sign, e.channel, e.u_scale_relative) for e in mapping.encoders
    )
    return TrialData(
        number=number,
        status="incomplete" if reason else "complete",
        reason=reason,
        started_utc=started_utc,
        simulated=mapping.simulated,
        sample_rate_hz=rate_hz,
        time_s=np.arange(raw.size, dtype=np.float64) * interval_s,
        raw_force_n=force,
        force_raw=raw,
        motor_command_v=volts,
        encoder_count=counts,
        encoders=encoders,
        force_info=take_same_fields(
            ForceInfo,
            cell,
            electrical=(cell.zero, cell.zero + 1.0),
            physical_n=(0.0, cell.scale),
            electrical_unit=cell.unit,
            mains_frequency_hz=mapping.mains_frequency_hz,
        ),
        blow_start_s=start_s,
    )


def _check_pushes(force_n: NDArray[np.float64], interval_s: float, what: str) -> None:
    """Refuse (RigInputError, which begins with ``what``) a force (n,), N, that falls from its rest far more than it
    rises: a push must be positive. A recording that begins within a push passes."""
    rest = force_n[: max(int(round(MINIMUM_QUIET_S / interval_s)), 1)]
    level = float(rest.mean())
    pull, push = level - float(force_n.min()), float(force_n.max()) - level
    if np.ptp(rest) < REST_SHARE * pull and pull > 2 * push and level < 0.5 * pull:
        raise RigInputError(
            f"{what} pulls by {pull:.3g} N and pushes by {push:.3g} N; a push must be positive: change the sign of "
            "force.newtons_per_unit"
        )


def _read_counts(table: ChannelTable, encoder: EncoderMapping, overruled: tuple[str, ...]) -> NDArray[np.int64]:
    """Counts (n,) of one encoder from its channel, angles converted to counts, wraps of its counter taken out;
    RigInputError for counts that are not whole or move too far; ``overruled``: channels whose stated unit is ignored.

    Raises `RigInputError` where values are no whole counts, wrap unsaid, or turn farther than a body can; ``overruled``
    names the channels whose unit in the file does not count (`check_unit`).
    """
    check_unit(table, encoder.channel, encoder.unit, overruled)
    values = table.channel(encoder.channel)
    if encoder.unit == "counts":
        whole = np.round(values)
        if encoder.counter_bits is not None:
            whole = _unwrap_counts(whole, encoder.counter_bits, f"{table.where}: {encoder.channel}")
            values = whole + (values - np.round(values))
        if np.any(whole != values):
            row = int(np.argmax(whole != values)) + 1
            raise RigInputError(
                f"{table.where}: {encoder.channel} row {row}: {values[row - 1]:g}, allowed whole counts"
            )
    else:
        turn = 360.0 if encoder.unit == "deg" else 2 * np.pi
        whole = np.round(values * (encoder.counts_per_revolution / turn))
    if np.abs(whole).max(initial=0.0) >= LARGEST_COUNT:
        raise RigInputError(f"{table.where}: {encoder.channel} reaches {np.abs(whole).max():.3g} counts, allowed 2^53")
    counts = whole.astype(np.int64)
    bits = None if encoder.unit != "counts" else next((b for b in COUNTER_BITS if has_wraps(counts, b)), None)
    if bits is not None:
        row = int(np.argmax(np.abs(np.diff(counts)))) + 2
        raise RigInputError(
            f"{table.where}: {encoder.channel} row {row}: {counts[row - 1]} counts come after {counts[row - 2]}, the "
            f"wrap of a counter of {bits} bits; say counter_bits = {bits} of this encoder in the mapping"
        )
    turned = 2 * np.pi * float(np.ptp(counts)) / encoder.counts_per_revolution
    if turned > LARGEST_TURN_RAD:
        raise RigInputError(
            f"{table.where}: {encoder.channel} turns by {turned:.3g} rad, allowed {LARGEST_TURN_RAD:.3g}; look at the "
            f"unit {encoder.unit!r} and counts_per_revolution = {encoder.counts_per_revolution} in the mapping"
        )
    return counts


def _unwrap_counts(values: Array, bits: int, what: str) -> Array:
    """Counts (n,) with the wraps of a counter of ``bits`` bits, signed or not, taken out; the first stays as it is.
    RigInputError, which begins with ``what``, for a count beyond its range."""
    span = 2.0**bits
    outside = (values < -span / 2) | (values >= span) | ((values >= span / 2) & (values.min() < 0))
    if outside.any():
        row = int(np.argmax(outside)) + 1
        raise RigInputError(
            f"{what} row {row}: {values[row - 1]:.0f} counts, more than a counter of counter_bits = {bits} holds"
        )
    steps = np.diff(values)
    return np.concatenate((values[:1], values[0] + np.cumsum(steps - span * np.round(steps / span))))


COUNTER_BITS = (16, 24, 32)  # of the counters of DAQ cards
WRAP_SHARE = 1 / 16  # of a counter's range, that a step between samples may have: beside it a wrap is sure


def has_wraps(counts: NDArray[np.int64], bits: int) -> bool:
    """Whether counts (n,) look like those of a counter of ``bits`` bits that wrapped: all within its range, a step of
    about all of it, and small steps otherwise."""
    span = 2**bits
    low, high = int(counts.min(initial=0)), int(counts.max(initial=0))
    steps = np.diff(counts)
    if not steps.size or high - low >= span or not (low >= -span // 2 and high < (span if low >= 0 else span // 2)):
        return False
    rest = np.abs(steps - span * np.round(steps / span))
    return bool(np.abs(steps).max() > span * (1 - WRAP_SHARE) and rest.max() <= span * WRAP_SHARE)


def values_beyond_limits(trial: TrialData, limits: LimitsConfig) -> str:
    """In words, with its row from 1, where the force, and each body's mean speed over 1 ms, first leave the limits,
    separated by semicolons; empty where none does."""
    said = []
    for name, beyond in (
        ("force_min_n", trial.raw_force_n < limits.force_min_n),
        ("force_max_n", trial.raw_force_n > limits.force_max_n),
    ):
        if beyond.any():
            row = int(np.argmax(beyond))
            limit = getattr(limits, name)
            said.append(f"row {row + 1}: force {trial.raw_force_n[row]:.4g} N, beyond limits.{name} = {limit:g} N")
    over = max(int(round(SPEED_OVER_S * trial.sample_rate_hz)), 1)
    angles = trial.angle_rad
    for encoder, angle in zip(trial.encoders, angles.T, strict=True):
        limit = limits.speed_rad_per_s[BODIES.index(encoder.name)]
        speed = np.abs(angle[over:] - angle[:-over]) * (trial.sample_rate_hz / over)
        if (speed > limit).any():
            first = int(np.argmax(speed > limit))
            row = first + 2 + int(np.argmax(np.abs(np.diff(angle[first : first + over + 1]))))
            said.append(
                f"row {row}: {encoder.name} {speed[first : first + over].max():.4g} rad/s, beyond "
                f"limits.speed_rad_per_s of {limit:g} rad/s"
            )
    return "; ".join(said)


def find_start(force_n: NDArray[np.float64], interval_s: float, where: str) -> float:
    """Time, s after the first sample, at which the force (n,), N, begins to rise from its rest; RigInputError, which
    begins with ``where``, for a record that does not begin with 20 ms of rest before a push."""
    quiet = int(round(MINIMUM_QUIET_S / interval_s))
    if quiet < ONSET_SAMPLES or force_n.size < 2 * quiet:
        raise RigInputError(f"{where}: too short or too slow to find the blow; give blow_start_s in the mapping")
    rest = force_n[:quiet]
    level, noise = float(rest.mean()), float(rest.std())
    peak = float(force_n.max()) - level
    threshold = max(ONSET_SIGMA * noise, ONSET_SHARE * peak)
    if peak <= 2 * ONSET_SIGMA * noise or peak <= 0 or np.ptp(rest) > REST_SHARE * peak:
        raise RigInputError(
            f"{where}: does not begin with {MINIMUM_QUIET_S:g} s of rest before a push; give blow_start_s in the "
            "mapping"
        )
    above = force_n - level > threshold
    first = int(np.argmax(above))
    smooth = np.convolve(force_n - level, np.ones(ONSET_SAMPLES) / ONSET_SAMPLES, "same")
    while first > 0 and smooth[first - 1] < smooth[first] and smooth[first - 1] > 0:
        first -= 1
    return first * interval_s
