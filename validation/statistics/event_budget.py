"""Uncertainty budget of the comparison of events: is a difference between model and trials an error of the model?

Conventions: E = S − D, model minus trial, mean over trials; standard uncertainties in the unit of the event.
u_val² = u_num² + u_input² + u_D² + u_repeat²; a model error is *resolved* when |E| > 2 u_val, and then lies within
E ± 2 u_val. When it is not, the model is not thereby shown to be right.
Source: ASME V&V 20-2009. u_num: the largest change when the tolerance is a tenth and a hundredth of the requested one.
u_input: force (gain, level, delay, noise) and parameters (draws; those of an identified set together, with their
correlations), propagated through the model and through the levels of the trial's own events, which come from the same
geometry, so that what both share cancels. u_D: what the encoders and the levels of rest leave open in the trials'
events. u_repeat: scatter of the paired differences over √n.
Draws the model cannot use, and draws in which the event does not happen, are counted in the table; a part of which
nothing is known is NaN, and the event is not judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

import model
from model.errors import ModelError
from validation.conventions import ENCODER_BODIES, Array
from validation.errors import PredictionError, ValidationInputError
from validation.events.definitions import EVENTS, Event
from validation.events.detect import find_events
from validation.measurement.geometry import ActionGeometry, motion_of
from validation.measurement.trial import MeasuredTrial
from validation.prediction.input_sampling import IDENTIFIED, Case, cases
from validation.prediction.many_runs import Run, run_many
from validation.prediction.model_under_test import ModelUnderTest

COVERAGE = 2.0
COLUMNS = [
    "event",
    "unit",
    "n",
    "difference",
    "u_num",
    "u_force",
    "u_parameters",
    "u_assumed",
    "u_input",
    "assumed_share",
    "u_d",
    "u_repeat",
    "u_val",
    "ratio",
    "low",
    "high",
    "resolved",
    "trial",
    "runs",
    "failed",
    "absent",
    "reading",
]
FORCE = ("force gain", "force level", "force delay", "force noise")


def event_budget(tested: ModelUnderTest, m: MeasuredTrial, summary: pd.DataFrame) -> pd.DataFrame:
    """Budget of every event both in the trials and in the model.

    Parameters
    ----------
    m : MeasuredTrial
        The trial whose inputs are changed.
    summary : DataFrame
        `validation.result_tables.events.event_summary`.

    Returns
    -------
    DataFrame
        event, unit, n, difference (E), u_num, u_force, u_parameters, u_assumed, u_input, assumed_share (of u_input²),
        u_d, u_repeat, u_val, ratio (|E| / u_val), low, high, resolved, trial (whose inputs were changed), runs, failed,
        absent (runs in which the event did not happen), reading.
    """
    inputs = cases(m, tested.action, tested.tolerance)

    outcomes = tested.store.value(
        "uncertainty budget",
        (tested.identity, inputs, m.time_s, m.change_rad, m.u_rad, m.quiet.stop),
        lambda: _outcomes(tested, m, inputs),
    )
    failed = sum(outcome is None for outcome in outcomes)
    rows = []
    for row in summary.itertuples():
        name = str(row.event)
        if not np.isfinite(row.difference) or row.unit == "1":  # a count has no budget
            continue
        groups: dict[str, list[float]] = {}
        absent = 0
        for case, outcome in zip(inputs, outcomes, strict=True):
            change = np.nan if outcome is None else outcome[name]
            absent += outcome is not None and not np.isfinite(change)
            groups.setdefault(case.group, []).append(change)
        rows.append(_row(row, groups) | {"trial": m.number, "runs": len(inputs), "failed": failed, "absent": absent})
    return pd.DataFrame(rows, columns=COLUMNS)


def _outcomes(tested: ModelUnderTest, m: MeasuredTrial, inputs: Sequence[Case]) -> list[dict[str, float] | None]:
    """Model minus trial of every event in each case; NaN where either does not happen; None when it cannot be run."""
    made = [_case_run(tested, m, case) for case in inputs]

    def outcome(i: int, solution: model.Solution) -> dict[str, float]:
        one = made[i]
        assert one is not None
        run, geometry = one
        rest = np.asarray(run.rest.angle_rad, dtype=float)
        change = (np.asarray(solution.angle_rad, dtype=float) - rest)[:, ENCODER_BODIES]
        predicted = _events(geometry, run.output_time_s, change, np.full(3, run.tolerance), m.quiet.stop)
        trial = _events(geometry, m.time_s, m.change_rad, m.u_rad, m.quiet.stop)
        return {name: predicted[name].value - trial[name].value for name in EVENTS}

    return run_many(tested, [None if one is None else one[0] for one in made], outcome)


def _case_run(tested: ModelUnderTest, m: MeasuredTrial, case: Case) -> tuple[Run, ActionGeometry] | None:
    """The run of a case, and the geometry its events are found with."""
    try:
        action = tested.action.with_values(case.changed) if case.changed else tested.action
        load = tested.load_of(action, case.preload_n)
    except (ModelError, PredictionError, ValidationInputError):  # no rest, or a key front that touches at rest
        return None
    time = m.time_s[(m.time_s >= case.time_s[0]) & (m.time_s <= case.time_s[-1])]
    return Run(action, load.rest, case.time_s, case.force_n, time, case.tolerance), load.geometry


def _events(geometry: ActionGeometry, time: Array, change: Array, u: Array, quiet_stop: int) -> dict[str, Event]:
    return find_events(motion_of(geometry, time, change, u), quiet_stop)


def _row(row: Any, groups: dict[str, list[float]]) -> dict[str, object]:
    base = groups.get("base", [float("nan")])[0]

    def spread(group: str) -> float:
        """Root mean square change of a group; its draws scatter about the base case. 0 of a group without cases."""
        if group not in groups:
            return 0.0
        change = np.array(groups[group]) - base
        known = change[np.isfinite(change)]
        return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")

    numerics = np.array(groups.get("numerics", [])) - base
    u_num = float(np.nanmax(np.abs(numerics))) if np.isfinite(numerics).any() else float("nan")
    u_force = float(np.sqrt(sum(spread(group) ** 2 for group in FORCE)))
    u_parameters = float(np.hypot(spread("stated parameters"), spread(IDENTIFIED)))
    u_assumed = spread("assumed parameters")
    u_input = float(np.sqrt(u_force**2 + u_parameters**2 + u_assumed**2))
    n = int(row.n_both)
    u_repeat = float(row.difference_s) / np.sqrt(n) if n > 1 else 0.0
    u_val = float(np.sqrt(u_num**2 + u_input**2 + row.u_trial**2 + u_repeat**2))
    e = float(row.difference)
    resolved = bool(abs(e) > COVERAGE * u_val)
    reading = "model error between low and high" if resolved else "cannot resolve a model error"
    return {
        "event": row.event,
        "unit": row.unit,
        "n": n,
        "difference": e,
        "u_num": u_num,
        "u_force": u_force,
        "u_parameters": u_parameters,
        "u_assumed": u_assumed,
        "u_input": u_input,
        "assumed_share": u_assumed**2 / u_input**2 if u_input != 0 else 0.0,
        "u_d": float(row.u_trial),
        "u_repeat": u_repeat,
        "u_val": u_val,
        "ratio": abs(e) / u_val if u_val > 0 else float("nan"),
        "low": e - COVERAGE * u_val,
        "high": e + COVERAGE * u_val,
        "resolved": resolved,
        "reading": reading if np.isfinite(u_val) else "not judged: its uncertainty is not known",
    }
