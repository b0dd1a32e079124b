"""What the threshold speed of eq. 2.10 does to a blow: the smoothed law at falling v_t beside set-valued friction.

The thesis does not print v_t and omega_t; this project takes 1e-3 m/s and 1e-2 rad/s. Both fall together here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from model.arrays import as_numbers
from model.files.figure_sheet import new_sheet
from model.files.force_table import check_force_table
from model.force_driven import simulate as simulate_smoothed
from model.parameters.action import Action
from model.scene.string_terms import with_modes
from model.simulation.solution import Solution
from model.stick_slip.march import Marched, simulate
from model.study.blow_measures import BlowMeasures, measure_blow


def draw(limit: Limit, path: str | Path) -> None:
    """Write the sheet to ``path`` (.svg, .pdf or .png)."""
    with new_sheet(path, 10.0, 4.2) as sheet:
        over_time, over_speed = sheet.subplots(1, 2)
        for v_t, solution in zip(limit.v_t, limit.smoothed, strict=True):
            height = 1e3 * solution.hammer_height_m(limit.action)
            over_time.plot(1e3 * solution.time_s, height, lw=1.0, label=f"eq. 2.10, v_t = {v_t:g} m/s")
        marched = limit.marched.solution
        over_time.plot(
            1e3 * marched.time_s,
            1e3 * marched.hammer_height_m(limit.action),
            "k--",
            lw=1.0,
            label="set-valued",
        )
        over_time.set(xlabel="time, ms", ylabel="hammer to string, mm", title="One blow")
        over_time.legend(fontsize="small")
        over_speed.loglog(limit.v_t, [limit.away_rad(s) for s in limit.smoothed], "o-", label="whole blow")
        held = [limit.away_until_release_rad(s) for s in limit.smoothed]
        over_speed.loglog(limit.v_t, held, "s--", label="until the release")
        over_speed.axhline(limit.march_error_rad, color="0.6", lw=1.0, ls=":", label="march, step halved")
        over_speed.set(
            xlabel="threshold speed v_t, m/s", ylabel="largest difference of any angle, rad", title="From the limit"
        )
        over_speed.legend(fontsize="small")
        for axes in (over_time, over_speed):
            axes.grid(alpha=0.3)


THRESHOLDS = (1e-2, 1e-3, 1e-4, 1e-5)
TOLERANCE = 1e-7
RATE_HZ = 5000.0
CREEP_S = 0.05


@dataclass(frozen=True)
class Limit:
    """One blow under the smoothed law at several threshold speeds, and in the limit.

    Attributes
    ----------
    action : as given
    v_t : (k,) threshold speeds, m/s; omega_t is the same number of times that of the given action
    smoothed : (k,) solutions
    marched : with set-valued friction, at the step asked for
    coarse : the same at twice that step, whose distance is a measure of the march's own error
    measures : (k + 1,) of the smoothed solutions, then of the march
    """

    action: Action
    v_t: tuple[float, ...]
    smoothed: tuple[Solution, ...]
    marched: Marched
    coarse: Marched
    measures: tuple[BlowMeasures, ...]

    def away_rad(self, solution: Solution) -> float:
        """Largest difference of any angle from the march."""
        return float(np.max(np.abs(solution.angle_rad - self.marched.solution.angle_rad)))

    def away_until_release_rad(self, solution: Solution) -> float:
        """Largest difference of any angle from the march up to the end of the hold."""
        held = self.marched.solution.time_s <= self.measures[-1].release_s
        return float(np.max(np.abs(solution.angle_rad - self.marched.solution.angle_rad)[held], initial=0.0))

    def creep_m_per_s(self, solution: Solution) -> float:
        """Mean speed at which the hammer leaves the string's side in the last ``CREEP_S`` of the hold; NaN without one.

        Friction that only resists where something slides lets a held hammer creep; what set-valued friction shows
        here is the motion that the falling force and the felt give.
        """
        time, end = solution.time_s, self.measures[-1].release_s
        window = (time >= end - CREEP_S) & (time <= end)
        if np.count_nonzero(window) < 2:
            return float("nan")
        height = solution.hammer_height_m(self.action)[window]
        return float(np.polyfit(time[window] - end, height, 1)[0])

    @property
    def march_error_rad(self) -> float:
        """Change of the march by halving its step."""
        return self.away_rad(self.coarse.solution)


def compare(
    action: Action,
    time_s: ArrayLike,
    force_n: ArrayLike,
    thresholds: ArrayLike = THRESHOLDS,
    step_s: float = 2.5e-6,
) -> Limit:
    """Simulate a blow at each threshold speed and march it without one; see `Limit`.

    Parameters
    ----------
    action : parameter set
    time_s, force_n : (k,) evenly spaced force table, s and N
    thresholds : threshold speeds v_t of eq. 2.10, m/s
    step_s : longest step of the march, s

    Returns
    -------
    Limit
        A solution for each threshold, the march, and measures of each blow.

    Raises
    ------
    InputError : a table that cannot be used, or a step out of range
    IntegrationError : an integration could not go on

    Examples
    --------
    >>> import model
    >>> time_s, force_n = model.force_table("forte")
    >>> begins = time_s < 0.1
    >>> limit = model.stick_slip.compare(model.load_action(), time_s[begins], force_n[begins], [1e-3], step_s=2e-5)
    >>> limit.v_t
    (0.001,)
    """
    speeds = tuple(as_numbers(thresholds, "threshold speeds", 1).tolist())
    action = with_modes(action, TOLERANCE)  # the same string in both
    times, forces = check_force_table(time_s, force_n)
    # events are read from rows at the table's times, which may be coarse
    parts = max(1, math.ceil((times[-1] - times[0]) / (len(times) - 1) * RATE_HZ - 1e-6))
    rows = np.arange((len(times) - 1) * parts + 1) / parts
    times, forces = (np.interp(rows, np.arange(len(times)), column) for column in (times, forces))
    marched, coarse = (simulate(action, times, forces, step) for step in (step_s, 2.0 * step_s))  # refuses at once
    ratio = action["friction_threshold.omega_t"] / action["friction_threshold.v_t"]
    smoothed = []
    for v_t in speeds:
        values = {"friction_threshold.v_t": v_t, "friction_threshold.omega_t": ratio * v_t}
        smoothed.append(
            simulate_smoothed(action.with_values(values), times, forces, tolerance=TOLERANCE, contact_forces=True)
        )
    measures = [measure_blow(action, solution, forces) for solution in (*smoothed, marched.solution)]
    return Limit(action, speeds, tuple(smoothed), marched, coarse, tuple(measures))
