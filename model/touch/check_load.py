"""Detect a back check that presses a hammer which still rises: a blow too loud for the regulation.

The wire is on the key. A key that is down before the hammer has left meets it on its way up and takes speed from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from model.files.force_table import check_force_table
from model.force_driven import simulate
from model.parameters.action import BACK_CHECK, Action, ActionLike, as_action
from model.simulation.hand_set_rest import hand_set_rest
from model.simulation.run import State
from model.simulation.solution import Solution
from model.touch.hammer_speed import RISE, SHORTEST, blow_length_s, string_contact_starts

RATE_HZ, COARSE_S = 10_000.0, 1e-3  # a catch lasts milliseconds; the strike is told to one
LONGEST_RISE_S = 1.0  # before the strike, in which it is looked for
LOAD_N = 0.1  # the hammer's own weight: less takes no speed that can be measured
RISING_M_PER_S = 0.05  # of the hammer, above which it still rises
SWITCHED_OFF = {f"{BACK_CHECK}.normal.{k}": v for k, v in (("a", 0.0), ("b", 0.0), ("c", 1e-3))}
"""A felt too soft to press; the scene keeps its contacts, so that nothing is compiled anew."""


@dataclass(frozen=True)
class CheckLoad:
    """Load of the back check on the rising hammer.

    Attributes
    ----------
    start_s : when it begins
    largest_n, largest_at_s : its peak
    strike_m_per_s, without_m_per_s : speed of the hammer at the string, and that without a back check; NaN where it
        does not reach the string
    """

    start_s: float
    largest_n: float
    largest_at_s: float
    strike_m_per_s: float
    without_m_per_s: float

    def __str__(self) -> str:
        speeds = [
            "never strikes" if math.isnan(v) else f"strikes at {v:.2f} m/s"
            for v in (self.strike_m_per_s, self.without_m_per_s)
        ]
        return (
            f"the back check presses the rising hammer from {1e3 * self.start_s:.1f} ms on, with up to "
            f"{self.largest_n:.1f} N at {1e3 * self.largest_at_s:.1f} ms: it {speeds[0]}, without the check it "
            f"{speeds[1]}"
        )


def find_check_load(
    action: ActionLike, time_s: ArrayLike, force_n: ArrayLike, whole: Solution | None = None, **keywords: Any
) -> CheckLoad | None:
    """Load (N) of the back check on the hammer before it first strikes, or before its highest point where it does not,
    and the speed at the string with and without the check; None where it bears none.

    Parameters
    ----------
    action : parameter set
    time_s, force_n : (k,) force table, as of `model.simulate`
    whole : solution of the same blow, every millisecond or finer, from which the strike is read; run where left out
    keywords : ``initial``, ``scene``, ``tolerance`` and ``method``, as of `model.simulate`

    Returns
    -------
    CheckLoad or None
        None where the rising hammer is free of it.

    Raises
    ------
    InputError, IntegrationError, StaticsError : as `model.simulate`

    Examples
    --------
    >>> import model
    >>> action = model.load_action("hirschkorn2004-regulated")
    >>> print(model.touch.find_check_load(action, [0, 0.02, 0.15], [0, 10, 10]))
    None
    """
    action = as_action(action)
    times, forces = check_force_table(time_s, force_n)
    if whole is None:
        whole = simulate(action, times, forces, output_time_s=_time_grid(times[0], times[-1], COARSE_S), **keywords)
    strike = string_contact_starts(whole.hammer_height_m)
    end = int(strike[0]) if len(strike) else int(np.argmin(whole.hammer_height_m))
    last = float(min(whole.time_s[end] + 2 * COARSE_S, whole.time_s[-1]))
    outputs = _time_grid(max(float(times[0]), last - LONGEST_RISE_S), last, 1.0 / RATE_HZ)
    blow = simulate(action, times, forces, output_time_s=outputs, contact_forces=True, **keywords)
    if blow.contact_normal_n is None or BACK_CHECK not in blow.contacts:
        return None
    height, approach = blow.hammer_height_m, blow.hammer_approach_m_per_s
    first = string_contact_starts(height)
    end = int(first[0]) + 1 if len(first) else int(np.argmin(height)) + 1
    load = blow.contact_normal_n[:end, blow.contacts.index(BACK_CHECK)]
    pressed = np.flatnonzero((load > LOAD_N) & (approach[:end] > RISING_M_PER_S))
    if not len(pressed):
        return None
    worst = int(pressed[np.argmax(load[pressed])])
    free = action.with_values(SWITCHED_OFF)
    return CheckLoad(
        start_s=float(outputs[pressed[0]]),
        largest_n=float(load[worst]),
        largest_at_s=float(outputs[worst]),
        strike_m_per_s=float(approach[first[0]]) if len(first) else math.nan,
        without_m_per_s=_strike_speed(free, times, forces, outputs, **keywords),
    )


def check_loads(action: Action, forces_n: np.ndarray) -> tuple[CheckLoad | None, ...]:
    """Load of the back check on the rising hammer for a blow of each force (n,), N, that is then held; None where the
    hammer is free of it."""
    rest, found = hand_set_rest(action), list[CheckLoad | None]()
    for force in forces_n.tolist():
        end = blow_length_s(force)
        start = State(0.0, rest.copy(), np.zeros(len(rest)))
        found.append(find_check_load(action, [0.0, RISE, end], [0.0, force, force], initial=start))
    return tuple(found)


def _time_grid(start: float, end: float, step: float) -> np.ndarray:
    return np.minimum(start + step * np.arange(math.floor((end - start) / step + 1e-9) + 1), end)


def _strike_speed(action: Action, times: np.ndarray, forces: np.ndarray, outputs: np.ndarray, **keywords: Any) -> float:
    """Speed at the string, m/s; NaN where it is not reached by 0.1 s after the end of ``outputs``."""
    end = min(float(times[-1]), float(outputs[-1]) + SHORTEST)
    fine = _time_grid(float(outputs[0]), end, 1.0 / RATE_HZ)
    blow = simulate(action, times, forces, output_time_s=fine, **keywords)
    first = string_contact_starts(blow.hammer_height_m)
    return float(blow.hammer_approach_m_per_s[first[0]]) if len(first) else math.nan
