"""Marks of a blow read from its samples, for many blows: the events of `model.sensitivity.EVENTS`, in microseconds.

Where a surface touches, the motion before it (or after it, where one lets go) is carried on to the touch: samples on
the other side of the kink say nothing about the time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.derived.columns import DEPTH, NORMAL
from model.derived.observe import contacts_at
from model.observables import head_height_m, key_dip_m, key_front_gap_m
from model.parameters.action import BACK_CHECK, JACK_KNUCKLE, LEVER_KNUCKLE, STRING, Action
from model.scene.build import Scene
from model.sensitivity.events import DIP_M, DROP_M, SHORTEST_HOLD_S

Array = NDArray[np.float64]

MARKS = (
    "onset_s", "key_bottom_s", "let_off_s", "let_off_m", "strike_s", "strike_m_per_s", "rebound_m_per_s", "check_m",
    "drop_s",
)  # fmt: skip
LET_OFF_WITHIN_S = 0.05  # before the strike
HOLD_SAMPLE_S = 1e-2
STRETCH = 30  # samples that are looked at together for the let-off


def blow_marks(action: Action, scene: Scene, motion: tuple[Array, Array, Array]) -> Array:
    """Marks (len(MARKS),) of a motion: times (m,), angles and speeds (m, n); NaN for what does not happen."""
    time, angle, speed = motion
    out = dict.fromkeys(MARKS, np.nan)
    height = head_height_m(action, scene.bodies, angle)
    out["onset_s"] = _passed(time, DIP_M - key_dip_m(action, angle), 0)
    out["key_bottom_s"] = _passed(time, key_front_gap_m(action, angle), 0)
    strike = _first_fall(height) if STRING in scene.contacts else -1
    if strike < 1:
        return np.array([out[name] for name in MARKS])
    at, rate = _carried_on(time, height, strike)
    out["strike_s"], out["strike_m_per_s"] = at, -rate
    leaves = np.flatnonzero((height[strike + 1 : -2] <= 0.0) & (height[strike + 2 : -1] > 0.0))
    if len(leaves):
        out["rebound_m_per_s"] = _carried_back(time, height, strike + 2 + int(leaves[0]))[1]
    k = _let_off(scene, motion, strike)
    if k >= 0:
        depth = np.array([_knuckle_depth(scene, angle[i], speed[i]) for i in (k, k + 1, k + 2)])
        out["let_off_s"] = _carried_back(time[k : k + 3], -depth, 0)[0]
        out["let_off_m"] = float(np.interp(out["let_off_s"], time[k - 3 : k + 3], height[k - 3 : k + 3]))
    out["check_m"], out["drop_s"] = _hold(scene, motion, height, strike)
    return np.array([out[name] for name in MARKS])


def _first_fall(y: Array) -> int:
    """Last sample before ``y`` first falls to zero; -1 where it never does."""
    at = np.flatnonzero((y[:-1] > 0.0) & (y[1:] <= 0.0))
    return int(at[0]) if len(at) else -1


def _passed(time: Array, y: Array, first: int) -> float:
    """When ``y`` first falls through zero, from the samples before; NaN where it never does."""
    k = _first_fall(y[first:])
    return _carried_on(time, y, first + k)[0] if k >= 1 else float("nan")


def _parabola(time: Array, y: Array) -> tuple[float, float]:
    """Rate and half the second derivative at the middle of three samples."""
    (h0, h1), (d0, d1) = np.diff(time), np.diff(y) / np.diff(time)
    bend = (d1 - d0) / (h0 + h1)
    return float(d0 + bend * h0), float(bend)


def _root(y: float, rate: float, bend: float, way: float) -> tuple[float, float]:
    """Time to the root of y + rate t + bend t^2 nearest to ``way``, and the rate there."""
    t = way
    for _ in range(8):
        slope = rate + 2.0 * bend * t
        t -= (y + (rate + bend * t) * t) / slope if slope else 0.0
    return t, rate + 2.0 * bend * t


def _carried_on(time: Array, y: Array, k: int) -> tuple[float, float]:
    """Time and rate at which ``y`` passes zero after sample ``k``, from the three samples up to it."""
    if k < 2:
        step = time[k + 1] - time[k]
        rate = (y[k + 1] - y[k]) / step
        return float(time[k] - y[k] / rate), float(rate)
    rate, bend = _parabola(time[k - 2 : k + 1], y[k - 2 : k + 1])
    back = float(time[k] - time[k - 1])
    t, slope = _root(float(y[k - 1]), rate, bend, 1.5 * back)
    return float(time[k - 1] + t), slope


def _carried_back(time: Array, y: Array, k: int) -> tuple[float, float]:
    """Time and rate at which ``y`` left zero before sample ``k``, from the three samples from there on."""
    rate, bend = _parabola(time[k : k + 3], y[k : k + 3])
    on = float(time[k + 1] - time[k])
    t, slope = _root(float(y[k + 1]), rate, bend, -1.5 * on)
    return float(time[k + 1] + t), slope


def _pressing(scene: Scene, angle: Array, speed: Array, contacts: tuple[str, ...]) -> NDArray[np.bool_]:
    """Whether any of some contacts presses, (m,)."""
    normal = contacts_at(scene.tables, scene.vector, angle, speed)[:, :, NORMAL]
    columns = [scene.contacts.index(c) for c in contacts if c in scene.contacts]
    out: NDArray[np.bool_] = np.any(normal[:, columns] > 0.0, axis=1)
    return out


def _let_off(scene: Scene, motion: tuple[Array, Array, Array], strike: int) -> int:
    """First sample after knuckle and what drives it have parted for the last time before the strike; -1 for none."""
    time, angle, speed = motion
    end = strike + 1
    while end > 0 and time[end] > time[strike] - LET_OFF_WITHIN_S:
        first = max(0, end - STRETCH)
        at = np.flatnonzero(_pressing(scene, angle[first:end], speed[first:end], (JACK_KNUCKLE, LEVER_KNUCKLE)))
        if len(at):
            k = first + int(at[-1]) + 1
            return k if 3 <= k <= strike - 2 else -1
        end = first
    return -1


def _knuckle_depth(scene: Scene, angle: Array, speed: Array) -> float:
    """How far the knuckle is pressed into what drives it, the deeper of both, m."""
    depth = contacts_at(scene.tables, scene.vector, angle[None], speed[None])[0, :, DEPTH]
    return max(float(depth[scene.contacts.index(c)]) for c in (JACK_KNUCKLE, LEVER_KNUCKLE) if c in scene.contacts)


def _hold(scene: Scene, motion: tuple[Array, Array, Array], height: Array, strike: int) -> tuple[float, float]:
    """Height of the hammer half-way through its hold, and when it drops from there; NaN where it is not held."""
    time, angle, speed = motion
    every = max(1, round(HOLD_SAMPLE_S / float(np.median(np.diff(time)))))
    at = np.arange(strike, len(time), every)
    held = at[_pressing(scene, angle[at], speed[at], (BACK_CHECK,))] if BACK_CHECK in scene.contacts else at[:0]
    if not len(held) or time[held[-1]] - time[held[0]] < SHORTEST_HOLD_S:
        return float("nan"), float("nan")
    middle = 0.5 * float(time[held[0]] + time[held[-1]])
    level = float(np.interp(middle, time, height))
    first = int(np.searchsorted(time, middle))
    return level, _passed(time, level + DROP_M - height, first)
