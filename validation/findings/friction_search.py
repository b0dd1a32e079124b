"""Which friction of the model is wrong, if one is: the single coefficient whose change explains the difference best.

Conventions: differences of key, whippen and hammer angles in units of each channel's range, before the release only.
Source: Gauss–Newton on one parameter at a time, in its logarithm; the change is then checked by a run. There is no
finding when the difference is small, when the uncertainty of the force may make it (a soft blow amplifies a
load cell's gain), or when no single coefficient takes nearly all of it away. A finding is a
suspicion: other errors of the model can look like friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict

import numpy as np

from model.errors import ModelError
from validation.conventions import ENCODER_BODIES, WORKERS, Array
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest

STEP = 0.1  # of the logarithm
LARGEST_FACTOR = 4.0
ROUNDS = 4
SMALLEST_DIFFERENCE = 4e-3  # of the range, root mean square
FORCE_MAY = 2.0  # standard uncertainties of the force's gain and level that a difference may come from
FORCE_LEAVES = 0.33  # of the squared difference
TAKES_AWAY = 0.95  # of the squared difference: with less, several things differ, and naming one would mislead


def wrong_friction(tested: ModelUnderTest, m: MeasuredTrial, until_s: float) -> list[SessionFinding]:
    """Name the one friction coefficient that explains the difference between model and trial; known results are reused.

    Parameters
    ----------
    m : MeasuredTrial
        A trial without other faults.
    until_s : float
        End of the differences taken into account: the release, after which they grow of themselves.
    """
    force = m.force
    found = tested.store.value(
        "friction search",
        (tested.identity, m.number, force.time_s, force.force_n, force.preload_n, m.time_s, m.change_rad, until_s),
        lambda: [asdict(finding) for finding in _search(tested, m, until_s)],
    )
    return [SessionFinding(**finding) for finding in found]


def _search(tested: ModelUnderTest, m: MeasuredTrial, until_s: float) -> list[SessionFinding]:
    force = m.force
    time = m.time_s[(m.time_s >= force.time_s[0]) & (m.time_s <= min(force.time_s[-1], until_s))]
    inside = np.isin(m.time_s, time)
    trial = m.change_rad[inside]
    extent = np.ptp(trial, axis=0)
    if time.size < 10 or not np.all(extent > 0):
        return []

    def residual(changed: dict[str, float], gain: float = 1.0, level_n: float = 0.0) -> Array | None:
        try:
            action = tested.action.with_values(changed) if changed else tested.action
            rest = tested.load_of(action, gain * force.preload_n + level_n).rest
            found = tested.simulate(
                action,
                force.time_s,
                gain * force.force_n + level_n,
                tolerance=tested.tolerance,
                output_time_s=time,
                initial=rest,
            )
        except ModelError:
            return None
        change = (
            np.asarray(found.angle_rad, dtype=float)[:, ENCODER_BODIES] - np.asarray(rest.angle_rad)[ENCODER_BODIES]
        )
        return np.asarray((change - trial) / extent).ravel()

    start = residual({})
    if start is None or math.sqrt(float(np.mean(start**2))) < SMALLEST_DIFFERENCE:
        return []
    by_force = (residual({}, gain=1 + force.channel.gain_relative_u), residual({}, level_n=force.u_level_n))
    if _explained_by_force(start, [moved - start for moved in by_force if moved is not None]):
        return []
    paths = [p for p, q in sorted(tested.action.quantities.items()) if p.endswith("friction.A") and q.value > 0]
    with ThreadPoolExecutor(WORKERS) as pool:
        stepped = list(pool.map(residual, [{p: tested.action[p] * math.exp(STEP)} for p in paths]))
    taken = {}
    for path, moved in zip(paths, stepped, strict=True):
        if moved is not None:
            slope = (moved - start) / STEP
            taken[path] = float((slope @ start) ** 2 / ((slope @ slope) * (start @ start))) if slope.any() else 0.0
    likely = sorted(taken, key=lambda p: -taken[p])[:3]
    with ThreadPoolExecutor(WORKERS) as pool:
        followed = list(pool.map(lambda path: _follow(residual, path, tested.action[path], start), likely))
    best: tuple[float, str, float] = (0.0, "", 1.0)
    for path, (factor, share) in zip(likely, followed, strict=True):
        best = max(best, (share, path, factor))
    share, path, factor = best
    if share < TAKES_AWAY:
        return []
    text = (
        f"model: {path} = {tested.action[path]:.3g} is suspected: {factor:.2f} times as much takes away "
        f"{100 * share:.0f} % of the squared difference from trial {m.number} until the release; measure this friction"
    )
    return [SessionFinding("wrong friction", float("nan"), path, factor, 1.0, text)]


def _explained_by_force(start: Array, moved: list[Array]) -> bool:
    """Whether gain and level of the force, within their uncertainty, may make most of the squared difference."""
    known = [x for x in moved if x.any()]
    if not known:
        return False
    columns = np.column_stack(known)
    least = np.linalg.lstsq(columns, -start, rcond=None)[0]
    left = start + columns @ np.clip(least, -FORCE_MAY, FORCE_MAY)
    return bool(left @ left < FORCE_LEAVES * (start @ start))


def _follow(
    residual: Callable[[dict[str, float]], Array | None], path: str, value: float, start: Array
) -> tuple[float, float]:
    """Factor on one parameter that leaves the smallest difference, and the share of its square taken away."""
    at, here = 0.0, start
    for _ in range(ROUNDS):
        moved = residual({path: value * math.exp(at + STEP)})
        if moved is None:
            break
        slope = (moved - here) / STEP
        step = -float(slope @ here) / float(slope @ slope) if slope.any() else 0.0
        limit = math.log(LARGEST_FACTOR)
        new = min(max(at + step, -limit), limit)
        there = residual({path: value * math.exp(new)})
        if there is None or float(there @ there) >= float(here @ here):
            break
        at, here = new, there
        if abs(step) < 0.01:
            break
    return math.exp(at), 1 - float(here @ here) / float(start @ start)
