"""Foreign recordings made into a session: one file, one trial; all are read and checked before anything is written.

The force keeps its recorded values (``force_raw``) beside newtons. Angles become counts of the stated resolution; a
motor command that was not recorded is NaN. Where the mapping does not say when the blow starts, it is detected in the
force, and the session notes that. The interval between samples is that of the recording's times, its own statement or
the mapping, which must agree.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError
from rig.foreign.channel_table import SECONDS, ChannelTable, even_interval, known
from rig.foreign.mapping import EncoderMapping, ImportMapping, MappingFile, check_unit
from rig.foreign.position_import import position_trials
from rig.foreign.reading import joined, read_segments
from rig.session import Session, SessionInfo
from rig.session.annotation_file import utc_now
from rig.session.channel_info import EncoderInfo, ForceInfo, of_same_name
from rig.session.info import FileInfo, PlanInfo
from rig.session.trial_data import TrialData
from rig.storage.atomic_write import sha256_of_bytes, sha256_of_file

RATES_HZ = (100.0, 1e6)
"""Sample rates a blow can have been recorded at; others mean a wrong unit of time."""
TIME_NAMES = re.compile(r"(t|time|zeit|temps|x_value)(_s)?", re.IGNORECASE)


def sample_interval(table: ChannelTable, mapping: ImportMapping) -> float:
    """Return the interval of the samples, s, by the mapping or the file.

    Raises RigInputError when they contradict each other, or no action was ever sampled like that.
    """
    time = mapping.time
    time_channel = time.channel if time.channel in table.channels or not table.clocks else None
    if time_channel is not None:
        check_unit(table, time_channel, time.unit, mapping.overrule_units)
    if time.sample_rate_hz is None:
        interval_s = table.interval(
            mapping.channels, time_channel, "time.sample_rate_hz in the mapping", unit=time.unit,
            same_start=time.same_start,
        )  # fmt: skip
    else:
        table.check_together(mapping.channels, time.same_start)
        interval_s = 1.0 / time.sample_rate_hz
        stated = table.stated_clock(mapping.channels)
        if stated is not None and not stated.agrees(interval_s):
            raise RigInputError(
                f"{table.where}: sample interval {stated.interval_s:g} s by the file itself, the mapping says "
                f"{interval_s:g} s"
            )
        _check_unmapped_times(table, table.channel(mapping.channels[0]).size, interval_s)
    rate_hz = 1.0 / interval_s
    if not RATES_HZ[0] <= rate_hz <= RATES_HZ[1]:
        raise RigInputError(
            f"{table.where}: sampled at {rate_hz:g} Hz, allowed {RATES_HZ[0]:g} to {RATES_HZ[1]:g} Hz; look at the "
            "unit of the times (time.unit in the mapping)"
        )
    return interval_s


def _check_unmapped_times(table: ChannelTable, size: int, interval_s: float) -> None:
    """Refuse a rate of the mapping that contradicts an unmapped column of even times in the file."""
    for name, values in table.channels.items():
        unit = known(table.units.get(name, "")) or ("s" if TIME_NAMES.fullmatch(name) else "")
        if unit not in SECONDS or values.size != size:
            continue
        try:
            found = even_interval(values * SECONDS[unit], name)
        except RigInputError:
            continue
        if abs(found - interval_s) * size > interval_s:
            raise RigInputError(
                f"{table.where}: {name} rises by {found:g} s, the mapping says {interval_s:g} s; name it as "
                "time.channel, or correct time.sample_rate_hz"
            )


QUIET_S = 0.02
ONSET = 0.01
LARGEST_COUNT = 2.0**53
LARGEST_TURN_RAD = np.pi
"""No part of an action turns this far; a larger angle means a wrong unit or scale."""


def import_session(out: str | Path, files: Sequence[Path], mapping: MappingFile) -> Session:
    """Make a session of foreign recordings.

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
        tables = _recordings(file, config)
        for part, table in enumerate(tables, 1):
            segment = f" segment {part} of {len(tables)}" if len(tables) > 1 else ""
            started, first = _started(table, file, config), len(trials) + 1
            if config.positions:
                for found in position_trials(table, config, sample_interval(table, config), first, started):
                    trials.append(found.data)
                    if found.reject:
                        rejected[found.data.number] = found.reject
            else:
                trials.append(make_trial(table, config, first, started))
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
        rig=FileInfo(name="imported", copy_name="mapping.toml", sha256=digest),
        profile=FileInfo(name="unknown"),
        plan=PlanInfo(trials=len(trials)),
        room=config.room,
        backend={"name": "import"},
        notes=notes,
    )
    session = Session.create(out, info, {"mapping.toml": mapping.text})
    for trial in trials:
        session.add_trial(trial)
    for number, reason in rejected.items():
        session.annotate(number, "reject", reason, author="import")
    return session


def _recordings(file: Path, config: ImportMapping) -> tuple[ChannelTable, ...]:
    """Return one table for each trial of a file."""
    segments = read_segments(file, separator=config.separator, decimal=config.decimal, thousands=config.thousands)
    if len(segments) == 1 or config.segments == "trials":
        return segments
    if config.segments is None:
        raise RigInputError(
            f'{file}: {len(segments)} segments; say in the mapping what they are: segments = "trials" or "join"'
        )
    names = config.channels
    timed = all(name in segment.clocks for segment in segments for name in names)
    return (joined(segments, names if timed or config.time.channel is None else [*names, config.time.channel]),)


def _started(table: ChannelTable, file: Path, config: ImportMapping) -> str:
    """Return when a recording began, ISO 8601.

    The file's own statement comes first: in UTC where its zone is known, without a zone where it is not. A file that
    does not say has only the time at which it was last changed.
    """
    if table.started:
        own = datetime.fromisoformat(table.started)
        if own.tzinfo is None and config.utc_offset_h is not None:
            own = own.replace(tzinfo=timezone(timedelta(hours=config.utc_offset_h)))
        return own.isoformat() if own.tzinfo is None else own.astimezone(UTC).isoformat()
    return datetime.fromtimestamp(file.stat().st_mtime, UTC).isoformat(timespec="seconds")


def make_trial(table: ChannelTable, mapping: ImportMapping, number: int, started_utc: str = "") -> TrialData:
    """Return a table's channels as a trial.

    Raises RigInputError when a channel is missing, has another unit, or has a value that is not finite or not a whole
    count.
    """
    cell = mapping.force
    if cell is None:
        raise RigInputError(f"{table.where}: the mapping has no [force]; a recording of positions is cut into strokes")
    check_unit(table, cell.channel, cell.unit, mapping.overrule_units)
    raw = table.channel(cell.channel)
    interval_s = sample_interval(table, mapping)
    rate_hz = 1.0 / interval_s
    force = (raw - cell.zero) * cell.scale
    _check_pushes(force, interval_s, f"{table.where}: {cell.channel}")
    counts = np.empty((raw.size, len(mapping.encoders)), dtype=np.int64)
    for k, encoder in enumerate(mapping.encoders):
        counts[:, k] = _counts(table, encoder, mapping.overrule_units)
    volts = np.full(raw.size, np.nan)
    if mapping.motor is not None:
        volts = table.channel(mapping.motor.channel) * mapping.motor.volts_per_unit
    start_s = mapping.blow_start_s
    if start_s is None:
        start_s = find_start(force, interval_s, table.where)
    elif not start_s < raw.size * interval_s:
        raise RigInputError(f"{table.where}: blow_start_s = {start_s:g} s, allowed below {raw.size * interval_s:g} s")
    encoders = tuple(
        EncoderInfo(e.name, e.counts_per_revolution, e.sign, e.channel, e.u_scale_relative) for e in mapping.encoders
    )
    info = {
        **of_same_name(ForceInfo, cell),
        "electrical": (cell.zero, cell.zero + 1.0),
        "physical_n": (0.0, cell.scale),
        "electrical_unit": cell.unit,
        "mains_frequency_hz": mapping.mains_frequency_hz,
    }
    return TrialData(
        number=number,
        status="complete",
        started_utc=started_utc,
        simulated=mapping.simulated,
        sample_rate_hz=rate_hz,
        time_s=np.arange(raw.size, dtype=np.float64) * interval_s,
        force_n=force,
        force_raw=raw,
        motor_command_v=volts,
        encoder_count=counts,
        encoders=encoders,
        force_info=ForceInfo(**info),
        blow_start_s=start_s,
    )


def _check_pushes(force_n: NDArray[np.float64], interval_s: float, what: str) -> None:
    """Refuse a force that leaves its rest in the wrong direction; a recording that begins within a push cannot tell."""
    rest = force_n[: max(int(round(QUIET_S / interval_s)), 1)]
    level = float(rest.mean())
    pull, push = level - float(force_n.min()), float(force_n.max()) - level
    if np.ptp(rest) < 0.1 * pull and pull > 2 * push and level < 0.5 * pull:
        raise RigInputError(
            f"{what} pulls by {pull:.3g} N and pushes by {push:.3g} N; a push must be positive: change the sign of "
            "force.newtons_per_unit"
        )


def _counts(table: ChannelTable, encoder: EncoderMapping, overruled: tuple[str, ...]) -> NDArray[np.int64]:
    check_unit(table, encoder.channel, encoder.unit, overruled)
    values = table.channel(encoder.channel)
    if encoder.unit == "counts":
        whole = np.round(values)
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
    turned = 2 * np.pi * float(np.ptp(counts)) / encoder.counts_per_revolution
    if turned > LARGEST_TURN_RAD:
        raise RigInputError(
            f"{table.where}: {encoder.channel} turns by {turned:.3g} rad, allowed {LARGEST_TURN_RAD:.3g}; look at the "
            f"unit {encoder.unit!r} and counts_per_revolution = {encoder.counts_per_revolution} in the mapping"
        )
    return counts


def find_start(force_n: NDArray[np.float64], interval_s: float, where: str) -> float:
    """Return when the force first leaves its rest for good, s.

    Raises RigInputError when the recording does not begin with rest, or has no push.
    """
    quiet = int(round(QUIET_S / interval_s))
    if quiet < 5 or force_n.size < 2 * quiet:
        raise RigInputError(f"{where}: too short or too slow to find the blow; give blow_start_s in the mapping")
    rest = force_n[:quiet]
    level, noise = float(rest.mean()), float(rest.std())
    peak = float(force_n.max()) - level
    threshold = max(5 * noise, ONSET * peak)
    if peak <= 10 * noise or peak <= 0 or np.abs(rest - level).max() > 0.05 * peak:
        raise RigInputError(
            f"{where}: does not begin with {QUIET_S:g} s of rest before a push; give blow_start_s in the mapping"
        )
    above = force_n - level > threshold
    first = int(np.argmax(above))
    smooth = np.convolve(force_n - level, np.ones(5) / 5, "same")
    while first > 0 and smooth[first - 1] < smooth[first] and smooth[first - 1] > 0:
        first -= 1
    return first * interval_s
