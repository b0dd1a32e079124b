"""Foreign recordings made into a session: one file, one trial; all are read and checked before anything is written.

Place in the data flow: CSV, LVM, TDMS or HDF5 with a mapping file → session folder like a recorded one. Force keeps its
values as they were (``force_raw``) beside newtons. Angles become counts of the stated resolution; a motor command that
was not recorded is NaN. Where the mapping does not say when the blow starts, it is found in the force and noted.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.durable import sha256_of_bytes, sha256_of_file
from rig.errors import InputError
from rig.foreign.channel_table import ChannelTable
from rig.foreign.mapping import EncoderMapping, Mapping, MappingFile, check_unit
from rig.foreign.reading import read_channels
from rig.session import Session, SessionInfo
from rig.session.annotation_file import utc_now
from rig.session.info import FileInfo, PlanInfo
from rig.session.records import EncoderInfo, ForceInfo, TrialData

QUIET_S = 0.02
ONSET = 0.01
LARGEST_COUNT = 2.0**53


def import_session(out: str | Path, files: Sequence[Path], mapping: MappingFile) -> Session:
    """Make a session of foreign recordings.

    Parameters
    ----------
    out : path
        Session folder to create.
    files : sequence of path
        Trial 1, 2, … in this order.

    Raises
    ------
    InputError
        When a file cannot be used or the folder not be created; nothing is left behind then.
    """
    if not files:
        raise InputError("no recording to import")
    config = mapping.config
    tables = [read_channels(file, separator=config.separator, decimal=config.decimal) for file in files]
    trials = [
        make_trial(table, config, number, _file_time(file))
        for number, (table, file) in enumerate(zip(tables, files, strict=True), 1)
    ]
    notes = {f"trial {n}": f"{file.name} sha256 {sha256_of_file(file)}" for n, file in enumerate(files, 1)}
    if config.blow_start_s is None:
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
    return session


def _file_time(file: Path) -> str:
    return datetime.fromtimestamp(file.stat().st_mtime, UTC).isoformat(timespec="seconds")


def make_trial(table: ChannelTable, mapping: Mapping, number: int, started_utc: str = "") -> TrialData:
    """Return a table's channels as a trial.

    Raises
    ------
    InputError
        When a channel is missing, has another unit, holds what is no finite number, or is no whole count.
    """
    wanted = mapping.force
    check_unit(table, wanted.channel, wanted.unit)
    raw = table.channel(wanted.channel)
    if mapping.time.channel is not None:
        check_unit(table, mapping.time.channel, "s")
    if mapping.time.sample_rate_hz is not None:
        interval_s = 1.0 / mapping.time.sample_rate_hz
        if table.interval_s is not None and abs(table.interval_s / interval_s - 1) > 1e-3:
            raise InputError(
                f"{table.where}: sample interval {table.interval_s:g} s by the file itself, the mapping says "
                f"{interval_s:g} s"
            )
    else:
        interval_s = table.interval(mapping.time.channel, "time.sample_rate_hz in the mapping")
    force = (raw - wanted.zero) * wanted.scale
    counts = np.column_stack([_counts(table, encoder) for encoder in mapping.encoders])
    volts = np.full(raw.size, np.nan)
    if mapping.motor is not None:
        volts = table.channel(mapping.motor.channel) * mapping.motor.volts_per_unit
    start_s = mapping.blow_start_s
    if start_s is None:
        start_s = find_start(force, interval_s, table.where)
    elif not start_s < raw.size * interval_s:
        raise InputError(f"{table.where}: blow_start_s = {start_s:g} s, allowed below {raw.size * interval_s:g} s")
    encoders = tuple(
        EncoderInfo(e.name, e.counts_per_revolution, e.sign, e.channel, e.u_scale_relative) for e in mapping.encoders
    )
    info = ForceInfo(
        sensor=wanted.sensor,
        calibration=wanted.calibration,
        electrical=(wanted.zero, wanted.zero + 1.0),
        physical_n=(0.0, wanted.scale),
        electrical_unit=wanted.unit,
        channel=wanted.channel,
        group_delay_s=wanted.group_delay_s,
        u_group_delay_s=wanted.u_group_delay_s,
        u_noise_n=wanted.u_noise_n,
        u_gain_relative=wanted.u_gain_relative,
        preload_n=wanted.preload_n,
        u_preload_n=wanted.u_preload_n,
        mains_frequency_hz=mapping.mains_frequency_hz,
    )
    return TrialData(
        number=number,
        status="complete",
        started_utc=started_utc,
        simulated=mapping.simulated,
        sample_rate_hz=1.0 / interval_s,
        time_s=np.arange(raw.size, dtype=np.float64) * interval_s,
        force_n=force,
        force_raw=raw,
        motor_command_v=volts,
        encoder_count=counts,
        encoders=encoders,
        force_info=info,
        blow_start_s=start_s,
    )


def _counts(table: ChannelTable, encoder: EncoderMapping) -> NDArray[np.int64]:
    check_unit(table, encoder.channel, encoder.unit)
    values = table.channel(encoder.channel)
    if encoder.unit == "counts":
        whole = np.round(values)
        if np.any(whole != values):
            row = int(np.argmax(whole != values)) + 1
            raise InputError(f"{table.where}: {encoder.channel} row {row}: {values[row - 1]:g}, allowed whole counts")
    else:
        turn = 360.0 if encoder.unit == "deg" else 2 * np.pi
        whole = np.round(values * (encoder.counts_per_revolution / turn))
    if np.abs(whole).max(initial=0.0) >= LARGEST_COUNT:
        raise InputError(f"{table.where}: {encoder.channel} reaches {np.abs(whole).max():.3g} counts, allowed 2^53")
    return whole.astype(np.int64)


def find_start(force_n: NDArray[np.float64], interval_s: float, where: str) -> float:
    """Return when the force first leaves its rest for good, s.

    Raises
    ------
    InputError
        When the recording does not begin with rest, or holds no push.
    """
    quiet = int(round(QUIET_S / interval_s))
    if quiet < 5 or force_n.size < 2 * quiet:
        raise InputError(f"{where}: too short or too slow to find the blow; give blow_start_s in the mapping")
    rest = force_n[:quiet]
    level, noise = float(rest.mean()), float(rest.std())
    peak = float(force_n.max()) - level
    threshold = max(5 * noise, ONSET * peak)
    if peak <= 10 * noise or peak <= 0 or np.abs(rest - level).max() > 0.05 * peak:
        raise InputError(
            f"{where}: does not begin with {QUIET_S:g} s of rest before a push; give blow_start_s in the mapping"
        )
    above = force_n - level > threshold
    first = int(np.argmax(above))
    smooth = np.convolve(force_n - level, np.ones(5) / 5, "same")
    while first > 0 and smooth[first - 1] < smooth[first] and smooth[first - 1] > 0:
        first -= 1
    return first * interval_s
