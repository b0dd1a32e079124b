"""Marks of a blow read from its samples, for many blows: the events of `model.sensitivity.EVENTS`, in microseconds.

Where a surface touches, the motion before it (or after it, where one lets go) is carried on to the touch: samples on
the other side of the kink say nothing about the time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from model.derived.columns import DEPTH, NORMAL
from model.observables import head_approach_m_per_s, head_height_m, key_dip_m
from model.parameters.action import BACK_CHECK, JACK_KNUCKLE, KEY_FRONT, LEVER_KNUCKLE, STRING, Action
from model.scene.build import Scene
from model.sensitivity.events import DIP_M, DROP_M, SHORTEST_HOLD_S, touches_at

Array = NDArray[np.float64]

MARKS = (
    "onset_s", "key_bottom_s", "let_off_s", "let_off_m", "strike_s", "strike_m_per_s", "rebound_m_per_s", "check_m",
    "drop_s",
)  # fmt: skip
LET_OFF_WITHIN_S = 0.05  # before the strike
HOLD_SAMPLE_S = 1e-2


def blow_marks(action: Action, scene: Scene, motion: tuple[Array, Array, Array]) -> Array:
    """Marks (len(MARKS),) of times (m,), coordinates and rates (m, n), with what joints give; NaN for what is not."""
    time, angle, speed = motion
    out = dict.fromkeys(MARKS, np.nan)
    height = head_height_m(action, scene.coordinates, angle)
    touches = touches_at(scene, angle, speed)
    depth, normal = (dict(zip(scene.contacts, touches[:, :, k].T, strict=True)) for k in (DEPTH, NORMAL))
    out["onset_s"] = _passed(time, DIP_M - key_dip_m(action, angle), 0)
    if KEY_FRONT in depth:
        out["key_bottom_s"] = _passed(time, -depth[KEY_FRONT], 0)
    strike = _first_fall(height) if STRING in scene.contacts else -1
    if strike < 1:
        return np.array([out[name] for name in MARKS])
    at, rate = _carried_on(time, height, strike)
    out["strike_s"], out["strike_m_per_s"] = at, -rate
    leaves = np.flatnonzero((height[strike + 1 : -2] <= 0.0) & (height[strike + 2 : -1] > 0.0))
    if len(leaves):
        k = strike + 2 + int(leaves[0])
        out["rebound_m_per_s"] = _carried_back(time, height, k)[1]
        if scene.pins or len(scene.tables.string):  # the head does not fly freely from there: as it goes on its way
            near = slice(k - 1, k + 1)
            leaving = -head_approach_m_per_s(action, scene.coordinates, angle[near], speed[near])
            way = CubicHermiteSpline(time[near], height[near], leaving)
            out["rebound_m_per_s"] = float(way(way.roots(extrapolate=False)[0], 1))
    driving = [c for c in (JACK_KNUCKLE, LEVER_KNUCKLE) if c in depth]
    pressed = np.any([normal[c] > 0.0 for c in driving], axis=0) & (time > time[strike] - LET_OFF_WITHIN_S)
    k = int(np.flatnonzero(np.append(True, pressed[: strike + 1]))[-1])  # 0 where nothing presses
    if 3 <= k <= strike - 2:  # pressed no more: the felt may still lie in, slower than what leaves it
        deepest = np.max([depth[c] for c in driving], axis=0)
        if deepest[k] < 0.0:  # felt that followed to the end: from the last sample in it, bent as the next ones are
            k -= 1
        out["let_off_s"] = _carried_back(time, -deepest, k)[0]
        out["let_off_m"] = float(np.interp(out["let_off_s"], time[k - 3 : k + 3], height[k - 3 : k + 3]))
    if BACK_CHECK in normal:
        out["check_m"], out["drop_s"] = _hold(time, normal[BACK_CHECK], height, strike)
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


def _hold(time: Array, checked_n: Array, height: Array, strike: int) -> tuple[float, float]:
    """Height of the hammer half-way through its hold, and when it drops from there; NaN where it is not held."""
    every = max(1, round(HOLD_SAMPLE_S / float(np.median(np.diff(time)))))
    at = np.arange(strike, len(time), every)
    held = at[checked_n[at] > 0.0]
    again = _first_fall(height[held[0] :]) if len(held) else -1
    held = held[held <= held[0] + again] if again >= 0 else held  # what is held after another strike is that one's
    if not len(held) or time[held[-1]] - time[held[0]] < SHORTEST_HOLD_S:
        return float("nan"), float("nan")
    middle = 0.5 * float(time[held[0]] + time[held[-1]])
    level = float(np.interp(middle, time, height))
    first = int(np.searchsorted(time, middle))
    return level, _passed(time, level + DROP_M - height, first)
