"""Frozen encoders and spikes of the force that are found, and false alarms in sound trials.

    python -m benchmarks reading_faults [--seed 51] [--trials 3] [--strokes mf,piano]

Sound trials are strokes by the printed specimen, by the bench's own and by specimens with effects that the model lacks.
In others a spike is added to the force, or an encoder holds its count, at a time drawn from the stroke.
"""

from __future__ import annotations

import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

import model
from benchmarks.runner import Run, Table
from benchmarks.what_is_said import FORCE, Case, frozen, in_trials, make_session, spiked
from validation.events.session_events import find_session_events
from validation.findings.finding import SessionFinding
from validation.findings.force_spikes import unanswered_spikes
from validation.findings.readings import encoder_readings
from validation.measurement.measure_session import measure_session
from validation.options import ComparisonOptions
from validation.pipeline.compare_session import model_under_test
from validation.prediction.predict_session import predict_session

SOUND = {
    "printed": (),
    "bench": (),
    "shank": ("shank",),
    "balance_rail": ("balance_rail",),
    "hammer_pin": ("hammer_pin",),
}
SPIKES = ((6.0, 1e-3), (3.0, 1e-3), (-4.0, 1e-3), (2.0, 2e-3), (-3.0, 3e-3))
FROZEN_S = (5e-3, 15e-3, 50e-3)
"""Spikes, N and s, and standstills of an encoder that are planted."""
FIRST_S, LAST_S = 0.26, {"spike": 0.5, "frozen": 0.33}
"""When they begin, at least and at most: a spike until the release, a standstill while the bodies move."""


def find_reading_faults(case: Case, seed: int) -> list[SessionFinding]:
    """What is found of the readings of each trial alone."""
    with tempfile.TemporaryDirectory() as folder:
        session = make_session(case, seed, Path(folder))
        options = ComparisonOptions.of({"keep_predictions": False, "rivals": (), "budget": False})
        tested = model_under_test(session, model.load_action(), options)
        predicted = predict_session(measure_session(session, tested.geometry_at, options.u_rest_level_m), tested)
        events = find_session_events(predicted, tested).trial
        releases = {number: named["key_release"] for number, named in events.items()}
        found: list[SessionFinding] = []
        for m in predicted.trials:
            p, release = predicted.predictions[m.number].model, releases[m.number]
            until_s = release.value if release.status != "absent" else float(m.time_s[-1])
            found += encoder_readings(m, p) + unanswered_spikes(tested, m, p, until_s)
    return found


def sound(name: str, kind: str, seed: int, trials: int) -> list[str]:
    """Texts of what is found in sound trials."""
    given = {"effects": SOUND[name]}
    case = Case("clean", "", trials * [kind], lambda n: given, specimen="bench" if name == "bench" else "printed")
    return [found.text for found in find_reading_faults(case, seed)]


def planted(kind: str, seed: int, what: str, size: float, length_s: float) -> list[str]:
    """Kinds of what is found where one spike (N) or one standstill (number of the encoder) is planted."""
    at_s = float(np.random.default_rng([seed, len(kind)]).uniform(FIRST_S, LAST_S[what]))
    change = spiked(FORCE, at_s, length_s, size) if what == "spike" else frozen(int(size), at_s, length_s)
    case = Case("glitch", "", [kind], misread=in_trials([1], change))
    return [found.kind for found in find_reading_faults(case, seed)]


def main(run: Run) -> bool:
    """Print both tables; whether no sound trial has a finding."""
    keys = [(name, kind, run.seed, run.trials) for name in SOUND for kind in run.strokes]
    alarms = [text for _, found in run.cases(keys, sound) for text in found]
    print("\n".join(alarms))
    n = len(keys) * run.trials
    print(f"{len(alarms)} false alarms in {n} sound trials")
    table = Table("planted:26", "found:8", "of:5")
    for what, sizes in (("spike", SPIKES), ("frozen", [(i, s) for s in FROZEN_S for i in range(3)])):
        for size, length_s in sizes:
            asked = [
                (kind, run.seed + k, what, float(size), length_s) for kind in run.strokes for k in range(run.repeats)
            ]
            kinds = Counter(bool(found) for _, found in run.cases(asked, planted))
            named = f"{size:+g} N" if what == "spike" else ("key", "whippen", "hammer")[int(size)]
            table.row(f"{what} {named}, {1e3 * length_s:g} ms", kinds[True], len(asked))
    return not alarms
