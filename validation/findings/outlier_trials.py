"""Trials that stand out from the others, each with a reason. They are flagged and stay in, never removed.

Conventions: distances of curves as in `validation.statistics.repeatability.distance_ratios`. With fewer than four
trials one trial cannot be told from the others, and none is flagged.
Source: with few trials no test of outliers has power (Grubbs at n = 5 can hardly reach its limit), so a trial is
flagged by how far it lies from the median of the others, when that is also more than a hundredth of the channel's range
(trials that agree perfectly make a small difference look large); the reason is looked for in what is known of its blow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from validation.conventions import ENCODER_CHANNELS, Array
from validation.events.definitions import EVENTS, Event
from validation.findings.between_trials.stroke_strength import onset_u_s, sustained_force_n
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial
from validation.statistics.common_base import on_common_base
from validation.statistics.repeatability import STANDS_OUT, distance_ratios

ODD = 5.0  # times the usual departure from the median
FAR = 0.01  # of the channel's range, root mean square
SMALL_FORCE = 0.02  # of the force held for 20 ms, below which a difference explains nothing
SMALL_TIME_S = 0.5e-3
ONSET_SIGMA = 5.0
SCALE_EXPLAINS = 0.9  # of the squared distance


def outlying(
    base: Array,
    traces: dict[int, pd.DataFrame],
    measured: Sequence[MeasuredTrial],
    events: dict[int, dict[str, Event]],
    explained: set[tuple[int, str]],
    reach: Callable[[int], float],
    until_s: float,
) -> list[SessionFinding]:
    """One finding per trial that stands out in channels nothing else explains.

    Parameters
    ----------
    base : (n,) array
        Common time base.
    traces, measured, events
        Of all trials.
    explained : set
        (trial, channel) of faults that are named already.
    reach : callable
        How far a trial may lie off because of its force alone, over the range; asked where no reason is found.
    until_s : float
        Where no reason is found, only what differs until then counts: after the release differences grow of themselves.
    """
    ratios: dict[int, dict[str, float]] = {}
    scales: dict[tuple[int, str], float] = {}
    distances: dict[tuple[int, str], float] = {}
    for channel in ENCODER_CHANNELS:
        curves = on_common_base(base, traces, f"{channel}_measured_rad")
        away = _away(curves)
        for j, (number, ratio, far) in enumerate(zip(traces, distance_ratios(curves), away, strict=True)):
            if ratio > STANDS_OUT and far > FAR and (number, channel) not in explained:
                ratios.setdefault(number, {})[channel] = float(ratio)
                scales[number, channel] = _scale(curves, j)
                distances[number, channel] = float(_away(curves[base <= until_s])[j])
    out = []
    for number, by_channel in ratios.items():
        worst = max(by_channel, key=lambda name: by_channel[name])
        reasons = _reasons(number, measured, scales[number, worst])
        if not reasons:
            reachable = reach(number)
            by_channel = {c: r for c, r in by_channel.items() if distances[number, c] > max(FAR, reachable)}
            if not by_channel:  # a stroke that amplifies what is not known of its force
                continue
            worst = max(by_channel, key=lambda name: by_channel[name])
        others = f" (also {', '.join(c for c in by_channel if c != worst)})" if len(by_channel) > 1 else ""
        why = "; ".join([*reasons, *_odd_events(number, events)]) or "no reason found in its force or its events"
        text = (
            f"trial {number} stands out in {worst}{others}: {by_channel[worst]:.1f} times as far from the others as is "
            f"usual; {why}; it is kept, annotate it to leave it out"
        )
        out.append(SessionFinding("outlying trial", number, worst, by_channel[worst], STANDS_OUT, text))
    return out


def _away(curves: Array) -> Array:
    """Root mean square distance of each trial from the median of all, over the median's range."""
    known = curves[np.isfinite(curves).all(axis=1)]
    if known.size == 0:
        return np.full(curves.shape[1], np.nan)
    middle = np.median(known, axis=1)
    extent = float(np.ptp(middle))
    distance = np.sqrt(np.mean((known - middle[:, None]) ** 2, axis=0))
    return np.asarray(distance / extent if extent > 0 else np.full(distance.shape, np.nan))


def _scale(curves: Array, j: int) -> float:
    """Factor by which a trial's readings are the others', when that explains nearly all of the distance; NaN else."""
    known = curves[np.isfinite(curves).all(axis=1)]
    middle, mine = np.median(np.delete(known, j, axis=1), axis=1), known[:, j]
    factor = float(middle @ mine) / float(middle @ middle)
    left = float(np.sum((mine - factor * middle) ** 2)) / float(np.sum((mine - middle) ** 2))
    return factor if left < 1 - SCALE_EXPLAINS else float("nan")


def _odd_events(number: int, events: dict[int, dict[str, Event]]) -> list[str]:
    """Events that happen, or do not, in this trial only."""
    reasons = []
    for name, kind in EVENTS.items():
        there = {n: e[name].status != "absent" for n, e in events.items()}
        same = sum(v == there[number] for v in there.values())
        if same <= 1 and len(there) > 2:
            reasons.append(
                f"{kind.title.lower()} {'happens' if there[number] else 'does not happen'} in this trial only"
            )
    return reasons


def _reasons(number: int, measured: Sequence[MeasuredTrial], scale: float) -> list[str]:
    """What is odd about a trial's readings or its blow."""
    reasons = []
    if np.isfinite(scale):
        reasons.append(f"its readings are {scale:.3f} times the usual ones all the way: look for a wrong scale")
    peak = {m.number: float(m.force.force_n.max()) for m in measured}
    onset = {m.number: m.quiet.onset_s for m in measured}
    middle = float(np.median(list(peak.values())))
    held = {m.number: sustained_force_n(m) for m in measured}
    usual = float(np.median(list(held.values())))
    if _odd(held, number) and abs(held[number] - usual) > SMALL_FORCE * usual:
        reasons.append(f"its peak force is {peak[number]:.1f} N, usual are {middle:.1f} N")
    small_s = max(SMALL_TIME_S, ONSET_SIGMA * max(onset_u_s(m) for m in measured))
    if _odd(onset, number) and abs(onset[number] - np.median(list(onset.values()))) > small_s:
        late = 1e3 * (onset[number] - float(np.median(list(onset.values()))))
        reasons.append(f"its blow begins {abs(late):.1f} ms {'later' if late > 0 else 'earlier'} than usual")
    return reasons


def _odd(values: dict[int, float], number: int) -> bool:
    others = np.array([v for n, v in values.items() if n != number])
    middle = float(np.median(others))
    usual = float(np.median(np.abs(others - middle)))
    return abs(values[number] - middle) > ODD * usual
