"""How often does the verdict's simultaneous test reject a model that is right within what it declares? And its power.

    python benchmarks/verdict_level.py [--sessions 40] [--trials 3,5,10] [--kinds forte,piano,double,staccato]
                                       [--seed 1] [--exact] [--results FILE] [--minutes M]

For every session the specimen's parameters, the force's gain, preload and delay, and the errors of the encoders are
drawn anew from their declared standard uncertainties; its trials differ in strength and pace. ``--exact``: the
specimen is the model, only force and sensors are drawn. The power is that against a shift of 1 to 6 standard
uncertainties, added to one channel of each session over the whole window. Prints a row per cell with its 99 % interval
and the mean p, which is 0.5 if the level is right at every level. ``--results`` keeps a line per session: what it
holds is not computed again, so that a long run can be stopped (``--minutes``) and go on; all cells grow alike.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model
from benchmarks.bench_strokes import BEFORE_S, KINDS
from model.errors import ModelError
from rig.configuration.rig_file import load_rig
from rig.session import EncoderInfo, ForceInfo, TrialData
from validation.events.session import find_session_events
from validation.measurement.trial import MeasuredTrial, measure
from validation.prediction.input_sampling import parameter_draws
from validation.prediction.model_under_test import ModelUnderTest
from validation.prediction.session import PredictedSession, PredictedTrial, predict_trial
from validation.scores.traces import SessionTraces, trace_table
from validation.statistics.paired_difference import DifferenceDraws, difference_draws, simultaneous_test

RATE_HZ, AFTER_S, DELAY_S, TOLERANCE = 5000.0, 0.4, 0.0024, 3e-5
SHIFTS = (1, 2, 3, 4, 5, 6)
CHANNELS = 3


def recorded(action: model.Action, kind: str, n: int, rng: np.random.Generator) -> list[TrialData]:
    """Trials of one kind on a specimen, read by sensors with drawn errors."""
    config = load_rig("virtual").config
    f = config.force
    gain = 1 + f.u_gain_relative * rng.standard_normal()
    delay = DELAY_S + f.u_group_delay_s * rng.standard_normal()
    preload = f.preload_n + f.u_preload_n * rng.standard_normal()
    encoders = tuple(EncoderInfo.of(e) for e in config.encoders)
    order = [("key", "whippen", "hammer").index(e.name) for e in encoders]
    turn = np.array([e.u_turn_relative for e in encoders]) * rng.standard_normal(len(encoders))
    change = np.array([e.u_change_rad for e in encoders]) * rng.standard_normal(len(encoders))
    rest = model.rest_state(action, force_n=preload)
    at, newton = KINDS[kind]
    t = np.arange(int((BEFORE_S + 1.2 * at[-1] + AFTER_S) * RATE_HZ)) / RATE_HZ
    out = []
    for number in range(1, n + 1):
        pace, strength = rng.uniform(0.98, 1.02), rng.uniform(0.98, 1.06)
        corners = BEFORE_S + rng.uniform(0, 1e-3) + pace * np.array(at)
        force = preload + strength * np.interp(t, corners, newton)
        solution = model.simulate(action, t, force, tolerance=TOLERANCE, initial=rest)
        true = (solution.angle_rad - rest.angle_rad)[:, [0, 1, 4]][:, order]
        read = true * (1 + turn) + change * (1 - np.exp(-np.abs(true) / 1e-3))
        per = np.array([e.rad_per_count for e in encoders])
        count = np.floor(read / per + rng.uniform(0, 1, len(per))).astype(np.int64)
        felt = np.interp(t - delay, t, force, left=force[0])
        seen = (felt - preload) / gain + 0.3 + f.u_noise_n * rng.standard_normal(t.size)
        info = ForceInfo.of(config, DELAY_S)
        out.append(
            TrialData(
                number=number, status="complete", started_utc="2026-11-22T09:00:00Z", simulated=True,
                sample_rate_hz=RATE_HZ, time_s=t, force_n=seen, force_raw=seen, motor_command_v=np.zeros(t.size),
                encoder_count=count - count[0], encoders=encoders, force_info=info, blow_start_s=BEFORE_S,
            )
        )  # fmt: skip
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
    """Outcome of one session as plain data; without ``p`` when its specimen cannot be played or judged."""
    out: dict[str, Any] = {"kind": kind, "n": n, "session": k, "seed": seed, "exact": exact}
    d = session_draws(kind, n, [seed, list(KINDS).index(kind), n, k], exact)
    outcome = None if d is None else simultaneous_test(d.found, d.draws, d.floor)
    if d is None or outcome is None:
        return out
    power = []
    for shift in SHIFTS:
        moved = [d.found.copy() for _ in range(CHANNELS)]
        for c, found in enumerate(moved):
            found[:, :, c] += shift * outcome.u[:, c]
        tests = [simultaneous_test(found, d.draws, d.floor) for found in moved]
        power.append([bool(t is not None and t.rejected) for t in tests])
    return out | {
        "rejected": bool(outcome.rejected), "factor": float(outcome.factor), "p": float(outcome.p),
        "excess": bool(outcome.excess_scatter), "power": power,
    }  # fmt: skip


def outcomes(
    asked: Sequence[tuple[str, int, int, int, bool]], file: Path | None, until: float
) -> Iterator[dict[str, Any]]:
    """Outcomes of the sessions asked for: those kept in the file, then new ones as long as there is time."""
    kept = {}
    if file is not None and file.exists():
        rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
        kept = {(r["kind"], r["n"], r["session"], r["seed"], r["exact"]): r for r in rows}
    for key in asked:
        if key not in kept:
            if time.monotonic() > until:
                continue
            kept[key] = judged(*key)
            if file is not None:
                with file.open("a", encoding="utf-8") as sheet:
                    sheet.write(json.dumps(kept[key]) + "\n")
        yield kept[key]


def table(rows: Sequence[dict[str, Any]], cells: Sequence[tuple[str, int]]) -> str:
    """Rejections by cell with their intervals, all cells together, and the power."""
    titles = f"{'kind':10s} {'n':>3s} {'sessions':>8s} {'rejected':>8s} {'share':>7s} {'99 % interval':>16s}"
    out = [f"{titles} {'factor':>7s} {'excess':>6s} {'mean p':>7s}"]

    def line(name: str, n: str, here: Sequence[dict[str, Any]]) -> str:
        rejected = sum(r["rejected"] for r in here)
        low, high = stats.binomtest(rejected, max(len(here), 1)).proportion_ci(0.99, "exact")
        factor, p = np.median([r["factor"] for r in here]), np.mean([r["p"] for r in here])
        return (
            f"{name:10s} {n:>3s} {len(here):8d} {rejected:8d} {rejected / len(here):7.3f} {low:7.3f} to {high:.3f} "
            f"{factor:7.2f} {sum(r['excess'] for r in here):6d} {p:7.2f}"
        )

    told = [r for r in rows if "p" in r]
    for kind, n in cells:
        here = [r for r in told if (r["kind"], r["n"]) == (kind, n)]
        if here:
            out.append(line(kind, str(n), here))
    if told:
        out.append(line("pooled", "", told))
        power = np.mean([r["power"] for r in told], axis=0)
        for shift, row in zip(SHIFTS, power, strict=True):
            out.append(f"shift of {shift} u: rejected {' '.join(f'{v:.2f}' for v in row)} (key, whippen, hammer)")
    out.append(f"{len(rows) - len(told)} sessions could not be played or judged")
    return "\n".join(out)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=40, help="of each cell")
    parser.add_argument("--trials", default="3,5,10")
    parser.add_argument("--kinds", default="forte,piano,double,staccato")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--exact", action="store_true")
    parser.add_argument("--results", type=Path, help="file of outcomes, a JSON line per session")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="start no session after this time")
    options = parser.parse_args()
    cells = list(product(options.kinds.split(","), map(int, options.trials.split(","))))
    asked = [(kind, n, k, options.seed, options.exact) for k in range(options.sessions) for kind, n in cells]
    until = time.monotonic() + 60 * options.minutes
    print(table(list(outcomes(asked, options.results, until)), cells))
    return 0


if __name__ == "__main__":
    sys.exit(main())
