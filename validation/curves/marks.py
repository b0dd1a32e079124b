"""Moments marked on the curves of a trial: the thesis's positions A, B and C, and the events of the toolkit.

Source of A, B, C: M. Hirschkorn (2004), section 3.2.2: at A the key reaches its bottom, at B the force is released
completely, at C the key has come back to its lowest point and begins to bounce. A is the event *key bottom*; B is when
the corrected force last exceeds `RELEASED` of its peak above rest before the key rises; C is the first minimum of the
key's rotation after the event *key release* that lies near its rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from validation.conventions import Array
from validation.events.definitions import EVENTS

RELEASED = 0.02  # of the peak above rest: choice, above noise of the channel
BOUNCE = 0.02  # of the largest rotation: by so much the key comes up again after C
DOWN = 0.2  # of the largest rotation: a key that stops higher than that on its way is not back
AT_REST = 25  # samples that give the force at rest, from the window's start
MARKED = ("onset", "let_off", "string_impact", "second_strike", "check_time", "key_release", "drop", "landing", "rest")


@dataclass(frozen=True)
class Mark:
    """A moment: its short label on a plot, time in s, and what it is."""

    label: str
    time_s: float
    meaning: str

    @property
    def position(self) -> bool:
        return self.label in ("A", "B", "C")


def trial_marks(frame: pd.DataFrame, events: pd.DataFrame) -> list[Mark]:
    """Marks of one trial in the order of time: its events, and the thesis's positions A, B, C; ``frame``: its trace
    inside the evaluation window, ``events``: table with a row for each of its measured events."""
    found = events[events["status"] != "absent"].set_index("event")["value"].dropna()
    marks = [
        Mark(EVENTS[name].title.lower(), float(found[name]), EVENTS[name].title) for name in MARKED if name in found
    ]
    if "key_bottom" in found:
        marks.append(Mark("A", float(found["key_bottom"]), "A: key reaches its bottom"))
    if "key_release" in found:
        release = float(found["key_release"])
        released = _find_release_time(frame["force_time_s"].to_numpy(), frame["force_n"].to_numpy(), release)
        if np.isfinite(released):
            marks.append(Mark("B", released, "B: force released completely"))
        back = _find_return_time(frame["time_s"].to_numpy(), -frame["key_measured_rad"].to_numpy(), release)
        if np.isfinite(back):
            marks.append(Mark("C", back, "C: key back at its lowest point"))
    return sorted(marks, key=lambda mark: mark.time_s)


def _find_release_time(time_s: Array, force_n: Array, key_release_s: float) -> float:
    """Time, s, at which the ``force_n`` (n,), N, at ``time_s`` (n,) falls below 2 % of its peak above rest: the last
    one before the key rises at ``key_release_s``, s, or, where it still acts then, the first after; NaN if none.

    A force that is still there when the key rises is followed to its end; what the motor arm does later, when it
    bounces on the resting key, does not count.
    """
    known = np.isfinite(force_n)
    if known.sum() < AT_REST:
        return float("nan")
    time, force = time_s[known], force_n[known]
    rest = float(np.median(force[:AT_REST]))
    above = force > rest + RELEASED * (float(force.max()) - rest)
    falls = np.flatnonzero(above[:-1] & ~above[1:])
    before = falls[time[falls] <= key_release_s]
    pressed = bool(above[min(int(np.searchsorted(time, key_release_s)), above.size - 1)])
    if before.size and not pressed:
        return float(time[before[-1]])
    after = falls[time[falls] > key_release_s]
    return float(time[after[0]]) if after.size else float("nan")


def _find_return_time(time_s: Array, rotation: Array, release_s: float) -> float:
    """Time, s, of the first minimum near rest of the key's ``rotation`` (n,), positive down, at ``time_s`` (n,), after
    ``release_s``, s; NaN where the key does not bounce after it."""
    after = (time_s >= release_s) & np.isfinite(rotation)
    if not after.any():
        return float("nan")
    late, curve = time_s[after], rotation[after]
    lowest, reach = np.minimum.accumulate(curve), float(np.nanmax(rotation))
    up = np.flatnonzero((curve > lowest + BOUNCE * reach) & (lowest < DOWN * reach))
    return float(late[int(np.argmin(curve[: up[0]]))]) if up.size and up[0] else float("nan")
