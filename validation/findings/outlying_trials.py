"""Trials unlike the others of their kind of stroke, by their curves or by their difference from the model.

Trials are flagged and stay in, never removed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from model.errors import ModelError
from validation.conventions import ENCODER_BODIES, ENCODER_CHANNELS, SIGMAS, Array
from validation.events.definitions import EVENTS, Event
from validation.events.session_events import SessionEvents
from validation.findings.finding import BLOW, PREDICTION, SessionFinding, register_kinds
from validation.findings.force import CLEAR_S
from validation.findings.limits import FAR
from validation.findings.stroke_kinds import onset_u_s, sustained_force_n
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedSession
from validation.statistics.repeatability import (
    FEWEST_TO_STAND_OUT,
    STANDS_OUT,
    compute_distance_ratios,
    interpolate_to_base,
)


@dataclass(frozen=True)
class Residuals:
    """Residuals over the range of the channel, by channel (n_samples, n_trials); numbers of the trials."""

    numbers: tuple[int, ...]
    by_channel: dict[str, Array]
    start_s: float
    until_s: float


def make_residuals(predicted: PredictedSession, events: SessionEvents, trials: Sequence[MeasuredTrial]) -> Residuals:
    """Residuals, model − trial over the channel's range, of key, whippen and hammer, (n_samples, n_trials) each, from
    the window's start to the first key release of the given trials.

    After the release differences grow of themselves; before it a trial's residual is its own force and the model's
    error, and the latter is common to all trials.
    """
    release = [events.trial[m.number]["key_release"] for m in trials]
    until = min((e.value for e in release if e.status != "absent"), default=events.window.end_s)
    by_channel: dict[str, Array] = {}
    if trials:
        time = trials[0].time_s
        base = time[(time >= events.window.start_s) & (time <= until)]
        for i, name in enumerate(ENCODER_CHANNELS):
            curves = []
            for m in trials:
                change = predicted.predictions[m.number].model.change_rad(name)
                curves.append(np.interp(base, m.time_s, change - m.change_rad[:, i], right=np.nan))
            extent = float(max(np.ptp(m.change_rad[:, i]) for m in trials))
            values = np.column_stack(curves)
            values = values[np.isfinite(values).all(axis=1)]
            if extent > 0 and len(values) > 1:
                by_channel[name] = values / extent
    return Residuals(tuple(m.number for m in trials), by_channel, events.window.start_s, float(until))


MAY = 3.0  # standard deviations
SCATTERS = 0.003  # of the force, one standard deviation
BETWEEN = 2.0  # a stroke that may go either way goes further than two predictions show


def estimate_force_effect(tested: ModelUnderTest, m: MeasuredTrial, start_s: float, end_s: float) -> float:
    """Twice the largest root mean square change of any encoder's predicted angle, over its range, from ``start_s`` to
    ``end_s``, when gain and level of the force are off by thrice their scatter; infinite where the model fails.
    Simulates, unless stored.

    One number for all bodies, which move each other: where one may go either way, none is told apart.

    Conventions: over the range, root mean square over a stretch of time. Gain and level of the force are moved
    together, up and down, by three times what they differ from trial to trial: 0.3 % of scatter of a bench's blows and
    the fitted offset; errors common to all trials do not count. Infinite where the model cannot be run.
    """
    force = m.force
    inside = (m.time_s >= max(force.time_s[0], start_s)) & (m.time_s <= min(force.time_s[-1], end_s))
    rest = tested.load(force.preload_n).rest
    gain, level = MAY * SCATTERS, MAY * force.hum.u_offset_n

    def angles(sense: float) -> Array:
        found = tested.simulate(
            tested.action,
            force.time_s,
            force.force_n + sense * (gain * (force.force_n - force.preload_n) + level),
            tolerance=tested.tolerance,
            output_time_s=m.time_s[inside],
            initial=rest,
        )
        return np.asarray(found.angle_rad, dtype=float)[:, ENCODER_BODIES]

    def run() -> float:
        try:
            middle = angles(0.0)
            moved = [np.sqrt(np.mean((angles(sense) - middle) ** 2, axis=0)) for sense in (-1.0, 1.0)]
        except ModelError:
            return math.inf
        extent = np.ptp(middle, axis=0)
        return BETWEEN * float(np.max(np.max(moved, axis=0) / extent)) if np.all(extent > 0) else math.inf

    inputs = (tested.identity, force.time_s, force.force_n, force.preload_n, gain, level, m.time_s[inside])
    return float(tested.store.value("force reach", inputs, run))


SMALL_FORCE = 0.02  # of the force held for 20 ms, below which a difference explains nothing
SCALE_EXPLAINS = 0.9  # of the squared distance


@register_kinds(
    {"outlying trial": "Look at the trial unlike the others; annotate it if it was no such blow."},
    spoils=BLOW,
)
def find_outlying_trials(
    base: Array,
    traces: dict[int, pd.DataFrame],
    measured: Sequence[MeasuredTrial],
    events: dict[int, dict[str, Event]],
    explained: set[tuple[int, str]],
    force_effect: Callable[[int], float],
    until_s: float,
) -> list[SessionFinding]:
    """One finding for each trial whose curve on the times ``base`` (n,), s, is far from the others' (value: distance
    over the usual), but for pairs (trial, channel) ``explained``; ``force_effect``: how far its force alone may move a
    trial, over the range.

    Conventions: distances of curves as in `validation.statistics.repeatability.compute_distance_ratios`. With fewer
    than four trials one cannot be told from the others, and none is flagged. Source: with few trials no test of
    outliers has power (Grubbs at n = 5 can hardly reach its limit), so a trial is flagged by how far it lies from the
    median of the others, when that is also more than a hundredth of the channel's range (trials that agree perfectly
    make a small difference look large); the reason is looked for in what is known of its blow.

    Parameters
    ----------
    base : (n,), common time base
    traces, measured, events : of all trials
    explained : (trial, channel) of faults that are named already
    force_effect : how far a trial may lie off by its force alone, over the range; asked where no reason is found
    until_s : where no reason is found, only what differs until then counts: after the release differences grow of
        themselves
    """
    ratios: dict[int, dict[str, float]] = {}
    scales: dict[tuple[int, str], float] = {}
    distances: dict[tuple[int, str], float] = {}
    for channel in ENCODER_CHANNELS:
        sound = {number: trace for number, trace in traces.items() if (number, channel) not in explained}
        if not sound:
            continue
        curves = interpolate_to_base(base, sound, f"{channel}_measured_rad")
        away = _measure_distances(curves)
        for j, (number, ratio, far) in enumerate(zip(sound, compute_distance_ratios(curves), away, strict=True)):
            if ratio > STANDS_OUT and far > FAR:
                ratios.setdefault(number, {})[channel] = float(ratio)
                scales[number, channel] = _fit_scale(curves, j)
                distances[number, channel] = float(_measure_distances(curves[base <= until_s])[j])
    out = []
    for number, by_channel in ratios.items():
        worst = max(by_channel, key=lambda name: by_channel[name])
        reasons = _find_reasons(number, measured, scales[number, worst])
        if not reasons:
            reachable = force_effect(number)
            by_channel = {c: r for c, r in by_channel.items() if distances[number, c] > max(FAR, reachable)}
            if not by_channel:  # a stroke that amplifies what is not known of its force
                continue
            worst = max(by_channel, key=lambda name: by_channel[name])
        others = f" (also {', '.join(c for c in by_channel if c != worst)})" if len(by_channel) > 1 else ""
        beside = "".join(f"; {one}" for one in [*reasons, *_find_unusual_events(number, events)])
        text = (
            f"trial {number} stands out in {worst}{others}: {by_channel[worst]:.1f} times as far from the others as is "
            f"usual (limit {STANDS_OUT:g}){beside}"
        )
        out.append(SessionFinding("outlying trial", number, worst, by_channel[worst], STANDS_OUT, text))
    return out


def _measure_distances(curves: Array) -> Array:
    """Root mean square distance (trials,) of each column of ``curves`` (n, trials) from the median column, over the
    median's range; rows with a NaN are skipped, NaN where none is left or the median does not vary."""
    known = curves[np.isfinite(curves).all(axis=1)]
    if known.size == 0:
        return np.full(curves.shape[1], np.nan)
    middle = np.median(known, axis=1)
    extent = float(np.ptp(middle))
    distance = np.sqrt(np.mean((known - middle[:, None]) ** 2, axis=0))
    return np.asarray(distance / extent if extent > 0 else np.full(distance.shape, np.nan))


def _fit_scale(curves: Array, j: int) -> float:
    """Factor of the j-th column (trial) over the others' median if it explains nearly all of the distance; NaN else."""
    known = curves[np.isfinite(curves).all(axis=1)]
    middle, mine = np.median(np.delete(known, j, axis=1), axis=1), known[:, j]
    factor = float(middle @ mine) / float(middle @ middle)
    left = float(np.sum((mine - factor * middle) ** 2)) / float(np.sum((mine - middle) ** 2))
    return factor if left < 1 - SCALE_EXPLAINS else float("nan")


def _find_unusual_events(number: int, events: dict[int, dict[str, Event]]) -> list[str]:
    """Sentences on events that happen in trial ``number`` only, or are absent in it only; ``events``: of all trials,
    trial number → event name → event. Empty with two trials or fewer."""
    reasons = []
    for name, kind in EVENTS.items():
        there = {n: e[name].status != "absent" for n, e in events.items()}
        same = sum(v == there[number] for v in there.values())
        if same <= 1 and len(there) > 2:
            reasons.append(
                f"{kind.title.lower()} {'happens' if there[number] else 'does not happen'} in this trial only"
            )
    return reasons


def _find_reasons(number: int, measured: Sequence[MeasuredTrial], scale: float) -> list[str]:
    """Sentences on what sets trial ``number``, one of ``measured``, apart from all: ``scale``, factor of its readings
    over the others' (NaN: none fits), its peak force, N, its onset; empty if nothing is unusual."""
    reasons = []
    if np.isfinite(scale):
        reasons.append(f"its readings are {scale:.3f} times the usual ones all the way")
    peak = {m.number: float(m.force.force_n.max()) for m in measured}
    onset = {m.number: m.quiet.onset_s for m in measured}
    middle = float(np.median(list(peak.values())))
    held = {m.number: sustained_force_n(m) for m in measured}
    usual = float(np.median(list(held.values())))
    if _is_unusual(held, number) and abs(held[number] - usual) > SMALL_FORCE * usual:
        reasons.append(f"its peak force is {peak[number]:.1f} N, usual are {middle:.1f} N")
    small_s = max(CLEAR_S, SIGMAS * max(onset_u_s(m) for m in measured))
    if _is_unusual(onset, number) and abs(onset[number] - np.median(list(onset.values()))) > small_s:
        late = 1e3 * (onset[number] - float(np.median(list(onset.values()))))
        reasons.append(f"its blow begins {abs(late):.1f} ms {'later' if late > 0 else 'earlier'} than usual")
    return reasons


def _is_unusual(values: dict[int, float], number: int) -> bool:
    others = np.array([v for n, v in values.items() if n != number])
    middle = float(np.median(others))
    usual = float(np.median(np.abs(others - middle)))
    return abs(values[number] - middle) > SIGMAS * usual


LARGER = 5.0  # times the others' usual residual: choice


@register_kinds(
    {"outlying residual": "Look at force and encoders of the trial that the model misses; annotate a disturbed blow."},
    spoils=PREDICTION,
)
def find_outlying_residuals(
    tested: ModelUnderTest, trials: dict[int, MeasuredTrial], residuals: Residuals
) -> list[SessionFinding]:
    """One finding for each trial that the model misses five times as far as it usually misses the others, in any
    channel; the value is that ratio. ``trials`` by number. None with fewer than four trials. Simulates the trials in
    doubt, unless stored.

    Conventions: residuals as in `residuals`, over the channel's range. A trial is named when its residual is five times
    as large as the others' usually are, lies four times as far from them as is usual and a hundredth of the range, and
    further than an error of its force may move it (`estimate_force_effect`; soft strokes amplify it). Not detectable
    with fewer than four trials.
    """
    if len(residuals.numbers) < FEWEST_TO_STAND_OUT:
        return []
    worst: dict[int, tuple[float, str]] = {}
    for channel, curves in residuals.by_channel.items():
        rms = np.sqrt(np.mean(curves**2, axis=0))
        ratio = compute_distance_ratios(curves)
        for j, number in enumerate(residuals.numbers):
            usual = float(np.median(np.delete(rms, j)))
            if not (ratio[j] > STANDS_OUT and rms[j] > LARGER * usual > 0):
                continue
            others = np.median(np.delete(curves, j, axis=1), axis=1)
            far = float(np.sqrt(np.mean((curves[:, j] - others) ** 2)))
            if far > FAR and far > estimate_force_effect(tested, trials[number], residuals.start_s, residuals.until_s):
                worst[number] = max(worst.get(number, (0.0, "")), (float(rms[j] / usual), channel))
    out = []
    for number, (times, channel) in worst.items():
        text = (
            f"trial {number}: the model, driven by its force, is {times:.0f} times as far from it in {channel} as from "
            f"the other trials, until the release (limit {LARGER:g})"
        )
        out.append(SessionFinding("outlying residual", number, channel, times, LARGER, text))
    return out
