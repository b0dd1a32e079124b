"""Trials of a recording of positions: one long table cut into strokes, without force and encoders.

The readings are kept as they were, after offset and gain; the displacement follows from the ruler points in every
trial file. A saturated sensor is refused; a stroke that is not whole, because the recording begins or ends with it,
becomes a trial with the status ``incomplete``. Levels of rest are those before each stroke: optical sensors drift.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError
from rig.foreign.channel_table import SECONDS, ChannelTable
from rig.foreign.mapping import ImportMapping, PositionMapping, check_unit
from rig.session.channel_info import NO_FORCE, ChannelInfo, RulerInfo
from rig.session.ruler import position_of
from rig.session.trial_data import TrialData

Array = NDArray[np.float64]

SUSTAINED_S = 2e-3
"""How long a departure must hold: a spike is no stroke."""
FIRST_S = 0.01
"""Rest by which it is told when the first stroke leaves it, where it does so within the time kept before a stroke."""


@dataclass(frozen=True)
class Cut:
    """A stroke: samples ``first`` to ``end``, ``trigger`` the first beyond the level; ``cut_off`` is empty or says why
    it is not whole.
    """

    first: int
    trigger: int
    end: int
    cut_off: str = ""


def cut_strokes(
    displacement: Array, travel: Array, rate_hz: float, *, trigger: float, pre_s: float, rest_s: float
) -> list[Cut]:
    """Find the strokes.

    Parameters
    ----------
    displacement : ndarray, shape (n, k)
        Of k sensors, m.
    travel : ndarray, shape (k,)
        Length of each one's ruler, m.
    rate_hz : float
    trigger : float
        Departure from the level of rest that begins a stroke, as a share of the travel.
    pre_s, rest_s : float
        Time kept before, and how long all must be back at the end, s. Strokes with less than ``rest_s`` and half of
        ``pre_s`` between them are one trial: the second would have no rest to begin from.
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
