"""How often does the verdict's simultaneous test reject a model that is right within what it declares? And its power.

For every session the specimen's parameters, the force's gain, preload and delay, and the errors of the encoders are
drawn anew from their declared standard uncertainties; its trials differ in strength and pace. ``--exact``: the
specimen is the model, only force and sensors are drawn. The power is that against a shift of 1 to 6 standard
uncertainties, added to one channel of each session over the whole window. Prints a row per cell with its 99 % interval
and the mean p, which is 0.5 if the level is right at every level. All cells grow alike.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pandas as pd

import model
from benchmarks.bench_strokes import BEFORE_S, KINDS
from benchmarks.identification_coverage import RATE_HZ, Sensors
from benchmarks.runner import Run, Table, interval, may_be
from model.errors import ModelError
from rig.session import TrialData
from validation.events.session_events import find_session_events
from validation.measurement.trial import MeasuredTrial, measure
from validation.prediction.input_sampling import parameter_draws
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedSession, PredictedTrial, predict_trial
from validation.scores.traces import SessionTraces, trace_table
from validation.statistics.paired_difference import DifferenceDraws, difference_draws, simultaneous_test

AFTER_S, TOLERANCE = 0.4, 3e-5
SHIFTS = (1, 2, 3, 4, 5, 6)
CHANNELS = 3
LEAST_POWER = 0.9  # at the largest shift


def recorded(action: model.Action, kind: str, n: int, rng: np.random.Generator) -> list[TrialData]:
    """Trials of one kind on a specimen, read by sensors with drawn errors."""
    sensors, (at, newton) = Sensors(rng), KINDS[kind]
    rest = model.rest_state(action, force_n=sensors.preload_n)
    t = np.arange(int((BEFORE_S + 1.2 * at[-1] + AFTER_S) * RATE_HZ)) / RATE_HZ
    out = []
    for number in range(1, n + 1):
        pace, strength = rng.uniform(0.98, 1.02), rng.uniform(0.98, 1.06)
        corners = BEFORE_S + rng.uniform(0, 1e-3) + pace * np.array(at)
        force = sensors.preload_n + strength * np.interp(t, corners, newton)
        solution = model.simulate(action, t, force, tolerance=TOLERANCE, initial=rest)
        out.append(sensors.read(number, t, force, solution.angle_rad - rest.angle_rad, rng))
    return out


def session_draws(kind: str, n: int, seed: list[int], exact: bool) -> DifferenceDraws | None:
    """Differences of one session, found and drawn; None when the specimen cannot be played."""
    rng = np.random.default_rng(seed)
    tested = ModelUnderTest(model.load_action(), TOLERANCE, rivals=())
    changed = {} if exact else parameter_draws(tested.action, 1, rng)[0]
    try:
        data = recorded(tested.action.with_values(changed), kind, n, rng)
    except ModelError:
        return None
    seal = f"{seed}"
    trials: list[MeasuredTrial] = [
        measure(d, None, tested.geometry_at(d.force_info.preload_n), seal=seal) for d in data
    ]
    found = {m.number: PredictedTrial(predict_trial(m, tested), {}, ()) for m in trials}
    predicted = PredictedSession(tuple(trials), found, {})
    events = find_session_events(predicted, tested)
    no_speeds = pd.DataFrame({"time_s": trials[0].time_s})
    frames = {m.number: trace_table(m, found[m.number], events.lifts[m.number], no_speeds) for m in trials}
    traces = SessionTraces(frames, {}, events.window, events.impact_s)
    return difference_draws(trials, traces, tested)


def judged(kind: str, n: int, k: int, seed: int, exact: bool) -> dict[str, Any]:
    """Outcome of one session as plain data; empty when its specimen cannot be played or judged."""
    d = session_draws(kind, n, [seed, list(KINDS).index(kind), n, k], exact)
    outcome = None if d is None else simultaneous_test(d.found, d.draws, d.floor)
    if d is None or outcome is None:
        return {}
    power = []
    for shift in SHIFTS:
        moved = [d.found.copy() for _ in range(CHANNELS)]
        for c, found in enumerate(moved):
            found[:, :, c] += shift * outcome.u[:, c]
        tests = [simultaneous_test(found, d.draws, d.floor) for found in moved]
        power.append([bool(t is not None and t.rejected) for t in tests])
    return {
        "rejected": bool(outcome.rejected), "factor": float(outcome.factor), "p": float(outcome.p),
        "excess": bool(outcome.excess_scatter), "power": power,
    }  # fmt: skip


def main(run: Run) -> bool:
    """Print rejections by cell, all together, and the power; whether 95 % may pass, and the largest shift is found."""
    cells = list(product(run.kinds, run.trials))
    found = run.cases([(kind, n, k, run.seed, run.exact) for k in range(run.sessions) for kind, n in cells], judged)
    told: dict[tuple[str, Any], list[dict[str, Any]]] = {cell: [] for cell in [*cells, ("pooled", None)]}
    silent = 0
    for (kind, n, *_), row in found:
        silent += not row
        for cell in ((kind, n), ("pooled", None)) if row else ():
            told[cell].append(row)
    table = Table(
        "kind:10s", "n:2d", "sessions:d", "rejected:d", "share:.3f", "99 % low:.3f", "high:.3f", "factor:.2f",
        "excess:d", "mean p:.2f",
    )  # fmt: skip
    for (kind, n), rows in told.items():
        if rows:
            hits = sum(r["rejected"] for r in rows)
            factor, p = np.median([r["factor"] for r in rows]), np.mean([r["p"] for r in rows])
            limits = interval(hits, len(rows), 0.99)
            table.row(kind, n, len(rows), hits, hits / len(rows), *limits, factor, sum(r["excess"] for r in rows), p)
    pooled = told["pooled", None]
    if pooled:
        for shift, power in zip(SHIFTS, np.mean([r["power"] for r in pooled], axis=0), strict=True):
            print(f"shift of {shift} u: rejected {' '.join(f'{v:.2f}' for v in power)} (key, whippen, hammer)")
    print(f"{silent} sessions could not be played or judged")
    low, high = interval(sum(r["rejected"] for r in pooled), len(pooled), 0.99)
    share, power = np.mean([r["rejected"] for r in pooled]), np.mean([r["power"][4] for r in pooled], axis=0)
    words = f"{100 * share:.1f} % (5 intended; 99 % interval {100 * low:.1f} to {100 * high:.1f} %)"
    run.figure("verdict-level", f"{words}; {power.min():.2f}–{power.max():.2f}")
    passed = sum(not r["rejected"] for r in pooled)
    return may_be(0.95, passed, len(pooled)) and bool(np.mean([r["power"][-1] for r in pooled]) > LEAST_POWER)
