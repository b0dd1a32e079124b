"""Do the verdict's intervals hold the error, how often is a right model resolved, and what is found of a wrong one?

Of every session the specimen's parameters, the gain, level and delay of the force and the errors of the encoders are
drawn from their declared uncertainties; its trials differ in strength and pace. In half of the sessions an effect is
planted: its error is what it changes in the same session, noise and all. Prints the share of right models that are
resolved, by kind of stroke and number of trials, the share of intervals that hold the error by quantity, and for each
stroke and effect the share of every outcome, and Y of the quantity that it moves most in units of u.
``--exact``: the specimen is the model, only force and sensors are drawn.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

import model
from benchmarks.bench_strokes import BEFORE_S, KINDS
from benchmarks.identification_coverage import RATE_HZ, Sensors
from benchmarks.runner import Run, Table, interval
from model.errors import ModelError
from rig.session import TrialData
from validation.events.session_events import find_session_events
from validation.measurement.trial import U_REST_LEVEL_M, MeasuredTrial, measure
from validation.prediction.input_sampling import parameter_draws
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.predict_session import PredictedSession, PredictedTrial, predict_trial
from validation.result import OUTCOMES
from validation.scores.traces import SessionTraces, make_trace_table
from validation.verdict.error_draws import SessionErrors, errors_of_trials, select_usable_errors, session_errors
from validation.verdict.quantities import QUANTITIES, relevance_limits
from validation.verdict.verdict import judge_model

AFTER_S, TOLERANCE = 0.4, 3e-5
NOTHING = "nothing"
FRICTION = (".joint_friction.A",)
MOVED = {
    "back check 1 mm": ("contact04.second.x", 1e-3),
    "back check 2 mm": ("contact04.second.x", 2e-3),
    "let-off button 0.5 mm": ("contact08.second.y", 0.5e-3),
    "drop screw 0.5 mm": ("contact11.first.y", 0.5e-3),
}
SCALED = {"friction × 1.2": 1.2, "friction × 1.5": 1.5}
SENSED = ("hammer scale 3 %", "encoders 0.5 ms late")
EFFECTS = (*MOVED, *SCALED, *SENSED)
TRIALS = (2, 3, 5, 6, 10, 30)


def with_effect(action: model.Action, effect: str) -> model.Action:
    """The specimen with what was planted in it."""
    if effect in MOVED:
        path, by = MOVED[effect]
        return action.with_values({path: action[path] + by})
    if effect in SCALED:
        paths = [path for path in model.quantities_of(action) if path.endswith(FRICTION)]
        return action.with_values({path: SCALED[effect] * action[path] for path in paths})
    return action


def misread(data: TrialData, effect: str) -> TrialData:
    """The record with what was planted in its sensors."""
    if effect == SENSED[0]:
        counts = data.encoder_count.astype(float)
        i = [e.name for e in data.encoders].index("hammer")
        counts[:, i] *= 1.03
        return replace(data, encoder_count=np.round(counts).astype(np.int64))
    if effect == SENSED[1]:
        late = round(0.5e-3 * data.sample_rate_hz)
        counts = np.vstack([np.repeat(data.encoder_count[:1], late, axis=0), data.encoder_count[:-late]])
        return replace(data, encoder_count=counts)
    return data


def recorded(specimen: model.Action, kind: str, n: int, effect: str, seed: list[int]) -> list[TrialData]:
    """Trials of one kind on a specimen, read by sensors with drawn errors; the same but for the effect."""
    rng = np.random.default_rng([*seed, 1])
    sensors, (at, newton) = Sensors(rng), KINDS[kind]
    own = with_effect(specimen, effect)
    rest = model.rest_state(own, force_n=sensors.preload_n)
    t = np.arange(int((BEFORE_S + 1.2 * at[-1] + AFTER_S) * RATE_HZ)) / RATE_HZ
    out = []
    for number in range(1, n + 1):
        pace, strength = rng.uniform(0.98, 1.02), rng.uniform(0.98, 1.06)
        corners = BEFORE_S + rng.uniform(0, 1e-3) + pace * np.array(at)
        force = sensors.preload_n + strength * np.interp(t, corners, newton)
        solution = model.simulate(own, t, force, tolerance=TOLERANCE, initial=rest)
        out.append(misread(sensors.read(number, t, force, solution.angle_rad - rest.angle_rad, rng), effect))
    return out


def compared(data: list[TrialData], tested: ModelUnderTest, seal: str) -> tuple[Any, ...]:
    """Predictions, traces and events of a session."""
    trials: list[MeasuredTrial] = [
        measure(d, None, tested.geometry_at(d.force_info.preload_n), seal=f"{seal} {d.number}") for d in data
    ]
    found = {m.number: PredictedTrial(predict_trial(m, tested), {}, ()) for m in trials}
    predicted = PredictedSession(tuple(trials), found, {})
    events = find_session_events(predicted, tested)
    no_speeds = pd.DataFrame({"time_s": trials[0].time_s})
    frames = {m.number: make_trace_table(m, found[m.number], events.lifts[m.number], no_speeds) for m in trials}
    return predicted, SessionTraces(frames, {}, events.window, events.impact_s), events


def true_errors(clean: tuple[Any, ...], tested: ModelUnderTest, errors: SessionErrors) -> np.ndarray:
    """What the same session without its effect differs by, mean over the same trials."""
    predicted, traces, events = clean
    found = errors_of_trials(predicted, traces, events, tested)
    every = np.array([found[number].errors for number in errors.trials])
    known = np.isfinite(every).all(axis=0)
    return np.where(known, np.where(known, every, 0.0).mean(axis=0), np.nan)


def judged(kind: str, n: int, k: int, seed: int, effect: str, exact: bool) -> dict[str, Any]:
    """Outcome of one session as plain data; empty when its specimen cannot be played."""
    key = [seed, list(KINDS).index(kind), n, k]
    tested = ModelUnderTest(model.load_action(), TOLERANCE, rivals=())
    changed = {} if exact else parameter_draws(tested.action, 1, np.random.default_rng(key))[0]
    try:
        specimen = tested.action.with_values(changed)
        session = compared(recorded(specimen, kind, n, effect, key), tested, f"{key}")
        clean = session if effect == NOTHING else compared(recorded(specimen, kind, n, NOTHING, key), tested, f"{key}")
    except ModelError:
        return {}
    predicted, traces, events = session
    errors = session_errors(
        predicted, tested, select_usable_errors(errors_of_trials(predicted, traces, events, tested)), (), U_REST_LEVEL_M
    )
    assert errors is not None
    verdict = judge_model(errors, relevance_limits({}))
    error = errors.sample.found - true_errors(clean, tested, errors)
    rows = {}
    for row in verdict.quantities.itertuples():
        true = float(error[next(i for i, q in enumerate(QUANTITIES) if q.name == row.quantity)])
        if np.isfinite(row.low) and np.isfinite(true):
            numbers = max(-row.detectable_low, row.detectable_high), float(true), float(row.limit), float(row.u)
            rows[row.quantity] = [bool(row.low <= true <= row.high), bool(row.resolved), *numbers]
    return {
        "outcome": verdict.outcome, "p": float(verdict.facts.get("p", np.nan)), "rows": rows,
        "branch": bool(verdict.estimates is not None and verdict.estimates.is_branch_resolved),
        "share": float(verdict.facts.get("branch_share", np.nan)),
    }  # fmt: skip


def cases(run: Run) -> list[tuple[Any, ...]]:
    """Sessions: in turns without and with an effect, every kind, the effects and numbers of trials in turn."""
    out = []
    for k in range(run.sessions):
        for i, kind in enumerate(run.kinds):
            n = run.trials[(k // 2 + i) % len(run.trials)]
            effect = NOTHING if k % 2 == 0 else run.effects[(k // 2) % len(run.effects)]
            out.append((kind, n, k, run.seed, effect, run.exact))
    return out


def main(run: Run) -> bool:
    """Print level, coverage and power; whether 5 % of right models may be resolved and 95 % of intervals hold."""
    found = [(key, row) for key, row in run.cases(cases(run), judged, run.workers) if row]
    right = [(key, row) for key, row in found if key[4] == NOTHING]
    level = Table(
        "sessions without an effect:s", "n:d", "resolved:d", "share:.3f", "95 % low:.3f", "high:.3f", "mean p:.2f"
    )
    groups = {"all": right} | {kind: [x for x in right if x[0][0] == kind] for kind in run.kinds}
    groups |= {f"{n} trials": [x for x in right if x[0][1] == n] for n in run.trials}
    for name, members in groups.items():
        if members:
            hits = sum(_is_resolved(row) for _, row in members)
            p = float(np.mean([row["p"] for _, row in members]))
            level.row(name, len(members), hits, hits / len(members), *interval(hits, len(members)), p)
    table = Table(
        "quantity:s", "intervals:d", "hold the error:.3f", "95 % low:.3f", "high:.3f", "planted:d", "hold:.3f"
    )
    held: list[tuple[int, int]] = []
    for q in QUANTITIES:
        every = [row["rows"][q.name][0] for _, row in found if q.name in row["rows"]]
        planted = [row["rows"][q.name][0] for key, row in found if q.name in row["rows"] and key[4] != NOTHING]
        if every:
            held += [(sum(every), len(every))] if q.is_primary else []
            share = sum(planted) / max(len(planted), 1)
            table.row(
                q.name, len(every), sum(every) / len(every), *interval(sum(every), len(every)), len(planted), share
            )
    heads = [f"{o.split(',')[-1].strip()[:24]}:.2f" for o in OUTCOMES]
    outcomes = Table("effect:<22s", "stroke:<10s", "n:3d", *heads, "Y:s")
    for effect, kind in product(run.effects, (*run.kinds, "all")):
        members = [row for key, row in found if key[4] == effect and kind in (key[0], "all")]
        if members:
            shares = [sum(row["outcome"] == o for row in members) / len(members) for o in OUTCOMES]
            outcomes.row(effect, kind, len(members), *shares, _detectable(members))
    hits = sum(_is_resolved(row) for _, row in right)
    low, high = interval(hits, len(right))
    run.figure(
        "verdict-coverage",
        f"{100 * hits / max(len(right), 1):.1f} % of {len(right)} right models resolved (5 intended; 95 % interval "
        f"{100 * low:.1f} to {100 * high:.1f} %); intervals hold in "
        f"{100 * min(h / n for h, n in held):.0f}–{100 * max(h / n for h, n in held):.0f} % a quantity (95 intended)",
    )
    low, high = interval(hits, len(right), 0.99)
    return low <= 0.05 <= high and all(interval(h, n, 0.999)[1] >= 0.93 for h, n in held)


def _is_resolved(row: dict[str, Any]) -> bool:
    return row["branch"] or any(values[1] for values in row["rows"].values())


def _detectable(members: list[dict[str, Any]]) -> str:
    """Median Y of the quantity that the effect moves most in units of u, with the median error."""
    moved = {
        q.name: np.median(
            [abs(row["rows"][q.name][3]) / row["rows"][q.name][5] for row in members if q.name in row["rows"]]
        )
        for q in QUANTITIES
        if q.is_primary and any(q.name in row["rows"] for row in members)
    }
    if not moved:
        return "branch"
    most = next(q for q in QUANTITIES if q.name == max(moved, key=lambda name: moved[name]))
    rows = [row["rows"][most.name] for row in members if most.name in row["rows"]]
    y, error, u = (most.factor * float(np.median([abs(r[i]) for r in rows])) for i in (2, 3, 5))
    return f"{most.title}: Y {y:.2g} {most.unit_shown}, error {error:.2g} = {error / u:.1f} u"
