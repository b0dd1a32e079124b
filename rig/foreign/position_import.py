"""Trials of a recording of positions: one long table cut into strokes, without force and encoders.

The readings are kept as they were, after offset and gain; the displacement follows from the ruler points in every
trial file. A saturated sensor is refused; a stroke that is not whole becomes a trial with the status ``incomplete``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError
from rig.foreign.channel_table import SECONDS, ChannelTable
from rig.foreign.mapping import ImportMapping, check_unit
from rig.foreign.position_mapping import PositionMapping
from rig.foreign.position_strokes import Cut, cut_strokes
from rig.session.channel_info import NO_FORCE, ChannelInfo
from rig.session.ruler import position_of
from rig.session.ruler_info import RulerInfo
from rig.session.trial_data import TrialData

Array = NDArray[np.float64]

SATURATED = 3
"""So many samples in a row at an end of the converter are no coincidence."""


@dataclass(frozen=True)
class PositionTrial:
    """A trial, why it does not count (empty where it does), and what the calibration is judged to be."""

    data: TrialData
    reject: str
    source_start_s: float


def position_trials(
    table: ChannelTable, mapping: ImportMapping, interval_s: float, first_number: int, started_utc: str
) -> list[PositionTrial]:
    """Cut a table of positions into trials.

    Parameters
    ----------
    table : ChannelTable
    mapping : ImportMapping
        With ``positions`` and without ``force``.
    interval_s : float
        Between samples.
    first_number : int
        Of the first trial.
    started_utc : str

    Raises
    ------
    RigInputError
        When a sensor is saturated, its calibration cannot be used, or nothing was played.
    """
    infos = tuple(channel_info(one) for one in mapping.positions)
    values = np.column_stack([_reading(table, one, mapping.overrule_units) for one in mapping.positions])
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
    origin = _origin(table, mapping), Path(table.where).name.removesuffix(".gz")
    return [
        _trial(mapping, infos, values, cut, interval_s, first_number + k, started_utc, origin)
        for k, cut in enumerate(cuts)
    ]


def channel_info(one: PositionMapping) -> ChannelInfo:
    """Return what a mapping says of a position sensor."""
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


def _reading(table: ChannelTable, one: PositionMapping, overruled: tuple[str, ...]) -> Array:
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


def _origin(table: ChannelTable, mapping: ImportMapping) -> float:
    """First time of the recording by its own clock, s; 0 where it has none."""
    name = mapping.time.channel
    if name is not None and name in table.channels:
        return float(table.channel(name)[0]) * SECONDS[mapping.time.unit]
    return 0.0


def _trial(
    mapping: ImportMapping,
    infos: tuple[ChannelInfo, ...],
    values: Array,
    cut: Cut,
    interval_s: float,
    number: int,
    started_utc: str,
    origin: tuple[float, str],
) -> PositionTrial:
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
        force_n=missing,
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
    return PositionTrial(data, next((one.reject for one in inside if one.reject), ""), start_s)
