"""Measures of one blow: strike, hold in the back check, bounces.

A solution with contact forces goes in, a `BlowMeasures` comes out; NaN where something did not happen. The hold ends
when the force falls below 95 % of its level 20 ms after the strike. The hammer is held if in the last 0.1 s of the hold
it moves by at most 1 mm and the back check presses for most of that time (after a soft blow it may let go for a moment
while the key still swings).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.errors import InputError
from model.files.time_table import two_columns
from model.parameters.action import BACK_CHECK, LEVER_KNUCKLE, STRING, ActionLike, as_action
from model.simulation.solution import Solution
from model.touch.hammer_speed import string_contact_starts

Array = NDArray[np.float64]

AFTER_STRIKE_S = 0.02  # s after the strike from which the force's level counts
HOLD_WINDOW_S = 0.1  # s before the release in which the height is the check height
HELD_WITHIN_M = 1e-3  # m, over that window: felt creeps by some tenths of a millimetre
LEVEL = 0.95  # share of the force's level below which the key is released


@dataclass(frozen=True)
class BlowMeasures:
    """One blow.

    Attributes
    ----------
    strike_s, strike_m_per_s : when and how fast the hammer first meets the string
    strikes : how often it met the string
    release_s : end of the hold
    held : caught by the back check until the release
    hold_m, hold_moved_m : middle and range of the hammer's distance from the string in the last 0.1 s of the hold
    lever_bounces : touches of knuckle and repetition lever between strike and release
    """

    strike_s: float
    strike_m_per_s: float
    strikes: int
    release_s: float
    held: bool
    hold_m: float
    hold_moved_m: float
    lever_bounces: int


def measure_blow(action: ActionLike, solution: Solution, force_n: ArrayLike) -> BlowMeasures:
    """Strike (s, m/s), strikes, whether and where (m) the back check holds the hammer, its movement and bounces, of a
    solution with contact forces and the force (m,), N, at its times; NaN where something did not happen.

    Parameters
    ----------
    action : the action that was simulated
    solution : with contact forces
    force_n : (m,) force at the solution's times, N

    Returns
    -------
    BlowMeasures
        NaN where something did not happen.

    Raises
    ------
    InputError : not one force for each time of the solution, or a solution without contact forces

    Examples
    --------
    >>> import model
    >>> action, (time_s, force_n) = model.load_action(), model.force_table("forte")
    >>> blow = model.simulate(action, time_s, force_n, contact_forces=True)
    >>> print(f"{model.study.measure_blow(action, blow, force_n).strike_m_per_s:.1f} m/s")
    2.3 m/s
    """
    solution = replace(solution, action=as_action(action))
    time, force_n = two_columns(solution.time_s, force_n, "force of the blow")
    normal = solution.contact_normal_n
    if normal is None:
        raise InputError("blow: found a solution without contact forces; simulate with contact_forces=True")
    height = solution.hammer_height_m
    met = string_contact_starts(height) if STRING in solution.contacts else np.empty(0, dtype=np.int64)
    strike = speed = math.nan
    if len(met):
        k = int(met[0])
        strike = float(time[k] + (time[k + 1] - time[k]) * height[k] / (height[k] - height[k + 1]))
        speed = float(solution.hammer_approach_m_per_s[k])
    after = strike if len(met) else float(time[np.argmax(force_n)])
    release = _release(time, force_n, after + AFTER_STRIKE_S)
    window = (time >= max(after + AFTER_STRIKE_S, release - HOLD_WINDOW_S)) & (time <= release)
    hold = moved = math.nan
    held = False
    bounces = 0
    if np.any(window):
        low, high = float(height[window].min()), float(height[window].max())
        hold, moved = 0.5 * (low + high), high - low
        checked = _column(solution, normal, BACK_CHECK)[window]
        held = bool(moved <= HELD_WITHIN_M and np.mean(checked > 0.0) > 0.5)
        lever = _column(solution, normal, LEVER_KNUCKLE)[(time >= after) & (time <= release)] > 0.0
        bounces = int(np.count_nonzero(lever[1:] & ~lever[:-1]))
    return BlowMeasures(strike, speed, len(met), release, held, hold, moved, bounces)


def _column(solution: Solution, normal: Array, contact: str) -> Array:
    """Normal force of a contact (m,), zero where the scene has none."""
    if contact not in solution.contacts:
        return np.zeros(len(normal))
    out: Array = normal[:, solution.contacts.index(contact)]
    return out


def _release(time: Array, force: Array, settled: float) -> float:
    """Last time (s) at which the force keeps its level at ``settled``."""
    if settled >= time[-1]:
        return float(time[-1])
    level = float(np.interp(settled, time, force))
    below = (time > settled) & (force < LEVEL * level)
    return float(time[np.argmax(below)]) if np.any(below) else float(time[-1])
