"""What a position sensor of the hammer shows of a stroke's events, by the same rules for a trial and a prediction.

Only what such a sensor can show: let-off and drop where the stroke is so slow that the hammer falls before it meets its
stop, the height of the check where the hammer comes to rest below the stop, its speed before the impact.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from validation.conventions import Array
from validation.measurement.positions import Stroke

PHASES = ("rest", "strike", "hold", "release")
REST, STRIKE, HOLD, RELEASE = range(4)
STARTED, DOWN, UP = 0.05, 0.9, 0.1
"""Shares of the key's travel: a strike begins above the first; above the second the key is down, below the third up."""
AFTER_DOWN_S, AFTER_UP_S = 0.06, 0.25
"""The key is held when it has been down so long; it rests when it has been up so long."""
AGAIN = 0.15
"""A key that turns back by this share of its travel has been let go, or is pressed again."""


@lru_cache(maxsize=64)
def find_phases(stroke: Stroke) -> NDArray[np.int64]:
    """Phase of each sample (n,) of a stroke, see `find_key_phases`."""
    return find_key_phases(stroke.key.value_m, stroke.interval_s)


def find_key_phases(key: Array, step: float) -> NDArray[np.int64]:
    """Phase of each sample (n,), an index of `PHASES`, of a key pressed by (n,) in any unit, ``step`` s apart.

    A strike begins when the key leaves its rest. It becomes a hold when the key has stayed down for a while, a release
    when the key has turned back by `AGAIN`, held or not; a key that turns round again by as much before it is up begins
    a new strike. So each note of a repetition is a strike of its own, though the key returns only part-way and is never
    held.
    """
    share = key / max(float(key.max()), 1e-9)
    out = np.zeros(share.size, dtype=np.int64)
    now, since, highest, lowest = REST, 0.0, 0.0, 1.0
    for k, x in enumerate(share):
        since += step
        if now == REST and x > STARTED:
            now, since, highest = STRIKE, 0.0, x
        elif now == STRIKE:
            highest = max(highest, x)
            since = since if x > DOWN else 0.0
            if since > AFTER_DOWN_S:
                now = HOLD
            elif x < highest - AGAIN:
                now, since, lowest = RELEASE, 0.0, x
        elif now == HOLD and x < DOWN:
            now, since, lowest = RELEASE, 0.0, x
        elif now == RELEASE:
            lowest = min(lowest, x)
            since = since if x < UP else 0.0
            if x > lowest + AGAIN:
                now, since, highest = STRIKE, 0.0, x
            elif since > AFTER_UP_S:
                now = REST
        out[k] = now
    return out


EVENTS = {
    "impact_s": "time of the hammer's highest place in the strike, s from the trial's first sample",
    "top_m": "how high that is, m: the end of the ruler where it met its stop",
    "speed_m_per_s": "speed of the hammer's calibrated point before it, from 60 to 90 % of the way, m/s",
    "let_off_m": "height at which the hammer falls from the jack, slow strokes only, m",
    "drop_m": "how far it falls then, m",
    "check_m": "height at which it is held while the key is down, m",
    "release_s": "time after the key has begun to rise at which the hammer is below half that height, s",
    "back_m": "how far down it comes before it strikes again in the trial, m: repetitions only",
}
SLOW_M_PER_S = 0.02
"""Speed of the calibrated point (some 0.25 m/s of the head) below which a stroke is a slow press."""
DROP_WITHIN_S = 0.3
STRUCK = 0.5
"""A strike brings the key down by more than this share of the stroke's deepest."""
FLIES_ON_S = 0.06
"""A hammer may strike so long after a key that was let go early has turned back."""
SPEED_FROM, SPEED_TO = 0.6, 0.9


def find_stroke_events(stroke: Stroke, hammer_m: Array) -> list[dict[str, float]]:
    """Events of every strike of a trial by its key and a hammer's displacement (n,), m; NaN where it does not show one.

    Strikes are told by the key alone, so that a trial and its prediction have the same ones, in the same order. A key
    that bounces on its rest is no strike.
    """
    every = find_key_strikes(stroke.key.value_m, find_phases(stroke))
    nexts = [*(start for start, _ in every[1:]), stroke.time_s.size]
    found = [_find_strike_events(stroke, hammer_m, *at, before) for at, before in zip(every, nexts, strict=True)]
    for one, following in zip(found, found[1:], strict=False):  # a hammer may still fall when the key is pressed again
        between = (stroke.time_s >= one["impact_s"]) & (stroke.time_s < following["impact_s"])
        if between.any():
            one["back_m"] = float(hammer_m[between].min())
    return found


def find_key_strikes(key: Array, at: NDArray[np.int64]) -> list[tuple[int, int]]:
    """First sample and end of every strike of a key (n,) with these phases (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at == STRIKE, [False]]).astype(np.int8)))
    pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [(a, b) for a, b in pairs if key[a:b].max() > STRUCK * float(key.max())]


def _find_strike_events(stroke: Stroke, hammer_m: Array, first: int, end: int, before: int) -> dict[str, float]:
    """Events of the strike of samples ``first`` to ``end``, whatever follows up to ``before``.

    A hammer that is still rising when the recording ends has met nothing yet.
    """
    out = dict.fromkeys(EVENTS, float("nan"))
    at, time_s = find_phases(stroke), stroke.time_s
    part = hammer_m[first : min(end + round(FLIES_ON_S / stroke.interval_s), before)]
    highest = float(part.max())
    top = first + int(np.argmax(part > highest - 0.005 * stroke.hammer.travel_m))
    if first + int(np.argmax(part)) == time_s.size - 1:
        return out
    out["impact_s"], out["top_m"] = float(time_s[top]), highest
    out["speed_m_per_s"] = _fit_speed(time_s[first : top + 1], hammer_m[first : top + 1], highest)
    if out["speed_m_per_s"] < SLOW_M_PER_S:
        after = hammer_m[top : top + round(DROP_WITHIN_S / stroke.interval_s)]
        out["let_off_m"], out["drop_m"] = highest, highest - float(after.min())
    hold = np.flatnonzero(at[end:before] != HOLD)
    stop = end + int(hold[0]) if hold.size else before
    if stop - end > 0.05 / stroke.interval_s:
        out["check_m"] = float(np.median(hammer_m[end:stop]))
        below = np.flatnonzero(hammer_m[stop:before] < 0.5 * out["check_m"])
        if below.size:
            out["release_s"] = float(time_s[stop + below[0]] - time_s[min(stop, time_s.size - 1)])
    return out


def _fit_speed(time_s: Array, hammer_m: Array, highest: float) -> float:
    inside = np.flatnonzero(hammer_m < SPEED_FROM * highest)
    low = int(inside[-1]) if inside.size else 0
    high = low + int(np.argmax(hammer_m[low:] >= SPEED_TO * highest))
    if high - low < 3:
        return float("nan")
    return float(np.polyfit(time_s[low : high + 1], hammer_m[low : high + 1], 1)[0])
