"""Why the hammer of a real piano came out too slow before its impact: the way it is measured, or the model?

    python -m benchmarks impact_speed [--seeds 5]

First table: recordings with known truth (`planted_positions`) go the whole way from sensors to prediction: speeds as
the sensors show them and as predicted from the key, over the true ones. Second: the training strokes of the real piano,
predicted with one parameter of the identified set moved at a time. Why: docs/explanation/positions.md.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import model
from benchmarks.planted_positions import SHIPPED, Specimen, compare, identified_specimen
from benchmarks.runner import Run
from rig.session import Session
from validation.events.strikes import find
from validation.identification.positions import read_identified
from validation.measurement.positions import Stroke, measure_stroke
from validation.prediction.positions import ACTION, NAMES, of_model

KINDS = ("medium", "fast", "fortissimo")
MOVED: dict[str, tuple[dict[str, float], tuple[str, ...]]] = {
    "as identified": ({}, ()),
    "shank bends": ({}, ("shank",)),
    "felt under the whippen twice as stiff": ({"key_felt": 0.69}, ()),
    "felt under the whippen half as stiff": ({"key_felt": -0.69}, ()),
    "hammer a fifth heavier": ({"hammer_mass": 0.9}, ()),
    "button 0.5 mm lower": ({"let_off": -0.25}, ()),
}
"""Specimens that are played: parameters moved by standard deviations of their priors, effects."""
TRAINING = (3, 5)
AT_KEY_M = 0.007
"""Where the hammer's lag behind the key is read: two thirds of the way, before let-off."""
HALF = 0.7
"""Parameters are moved by so many standard deviations of their priors, up or down; factors of e by half."""


def main(run: Run) -> bool:
    """Print both tables; whether speeds are seen within a tenth of the true ones."""
    worst = planted(run.seeds, run.specimens)
    parameters(run.parameters)
    return worst < 0.1


def planted(seeds: int, names: list[str]) -> float:
    """Print speeds over the true ones, of every specimen and kind; how far the worst mean seen is off."""
    worst = 0.0
    print(f"speed from 60 to 90 % of the way over the true one, mean (sd) of {seeds} recordings: seen; predicted")
    print(f"{'specimen':40s}" + "".join(f"{kind:>28s}" for kind in KINDS))
    for name, (moved, effects) in MOVED.items():
        if names and name not in names:
            continue
        rows = [_speeds(identified_specimen(moved, effects, seed)) for seed in range(seeds)]
        cells = []
        for k in range(len(KINDS)):
            seen, made = np.array([row[k] for row in rows]).T
            worst = max(worst, abs(float(seen.mean()) - 1.0))
            cells.append(f"{seen.mean():.2f} ({seen.std():.2f}); {made.mean():.2f} ({made.std():.2f})")
        print(f"{name:40s}" + "".join(f"{cell:>28s}" for cell in cells), flush=True)
    return worst


def _speeds(specimen: Specimen) -> list[tuple[float, float]]:
    with tempfile.TemporaryDirectory() as folder:
        truths, found = compare(specimen, KINDS, Path(folder))
    first = found.events[found.events["strike"] == 1].set_index(["source", "trial"])["speed_m_per_s"]
    return [
        (first["measured", k] / truth.speed(), first["identified", k] / truth.speed())
        for k, truth in enumerate(truths, 1)
    ]


def parameters(names: list[str]) -> None:
    """Print what each parameter does to the training strokes of the real piano."""
    session, record = Session.open(SHIPPED), read_identified(SHIPPED)
    strokes = [measure_stroke(session.trial(number).read()) for number in TRAINING]
    predict, z = of_model(model.load_action(record.action)), np.array(record.z)
    heads = "; ".join(f"trial {s.number} {s.condition}" for s in strokes)
    print(f"\nspeed before the impact, mm/s, and hammer at {1e3 * AT_KEY_M:g} mm of the key, mm: {heads}")
    print(f"{'measured':64s}{_row([(s, s.hammer.value_m) for s in strokes])}")
    print(f"{'identified':64s}{_row([(s, predict(z, s, None)) for s in strokes])}")
    for one in (one for one in ACTION if not names or one.name in names):
        for by in (-HALF, HALF):
            moved = z.copy()
            moved[NAMES.index(one.name)] += by
            try:
                made = [(s, predict(moved, s, None)) for s in strokes]
            except model.ModelError as error:
                print(f"{one.meaning:56s}{by:+.1f} sd  {str(error)[:60]}")
                continue
            print(f"{one.meaning:56s}{by:+.1f} sd {_row(made)}", flush=True)
    printed = z.copy()
    printed[NAMES.index("key_felt")] = 0.0
    made = [(s, predict(printed, s, None)) for s in strokes]
    print(f"{'felt between key and whippen as in the printed set':64s}{_row(made)}")


def _row(made: list[tuple[Stroke, np.ndarray]]) -> str:
    cells = []
    for stroke, hammer_m in made:
        at = int(np.argmax(stroke.key.value_m > AT_KEY_M))
        cells.append(f"{1e3 * find(stroke, hammer_m)[0]['speed_m_per_s']:7.1f} {1e3 * hammer_m[at]:6.2f}")
    return "  ".join(cells)
