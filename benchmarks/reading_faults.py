"""Frozen encoders and spikes of the force that are found, and false alarms in sound trials.

    python -m benchmarks reading_faults [--seed 51] [--trials 4] [--strokes mf,piano]

Sound trials are strokes by the printed specimen, by the bench's own and by specimens with effects that the model lacks.
In the second of others a spike is added to the force, at any time until 0.5 s or while the key rings on its bed, or an
encoder holds its count. A standstill that misreads by less than 0.5 mrad is none that could be seen.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import model
from benchmarks.bench_strokes import stroke_of
from benchmarks.runner import Run, Table
from benchmarks.what_is_said import FORCE, Case, frozen, in_trials, make_session, spiked
from validation import compare as compare_session

SOUND = ("printed", "bench", "shank", "balance_rail", "hammer_pin")
KINDS = ("unanswered force spike", "reading stands still", "reading leaps", "gap")
SPIKES = ((6.0, 1e-3), (3.0, 1e-3), (-4.0, 1e-3), (2.0, 2e-3), (-3.0, 3e-3), (-3.0, 15e-3))
FROZEN_S = (5e-3, 15e-3, 50e-3)
"""Spikes, N and s, and standstills of an encoder that are planted."""
FIRST_S, LAST_S, RINGS_S = 0.26, {"spike": 0.5, "frozen": 0.33}, 0.04
"""When they begin, at least and at most, and so long after the largest force the key rings on its bed."""
PLANTED, SEEN_RAD = 2, 0.5e-3


def find_reading_faults(case: Case, seed: int) -> list[tuple[str, int, str]]:
    """Kind, trial and text of what is found of the readings."""
    options: Any = {"keep_predictions": False, "rivals": (), "budget": False, "explain": False}
    with tempfile.TemporaryDirectory() as folder:
        found = compare_session(make_session(case, seed, Path(folder)), model.load_action(), **options).findings
    return [(f.kind, int(f.trial), f.text) for f in found.itertuples() if f.kind in KINDS]


def sound(name: str, kind: str, seed: int, trials: int) -> list[str]:
    """Texts of what is found in sound trials."""
    given = {"effects": (name,) if name in SOUND[2:] else ()}
    case = Case("clean", "", trials * [kind], lambda n: given, specimen="bench" if name == "bench" else "printed")
    return [text for *_, text in find_reading_faults(case, seed)]


def planted(kind: str, seed: int, trials: int, what: str, size: float, length_s: float) -> tuple[bool, int, float]:
    """Whether what was planted (N, or the number of an encoder) is found, what else is, and by how much it misreads."""
    stroke = stroke_of(kind, seed, PLANTED, "printed", ())
    rng, time_s = np.random.default_rng([seed, len(kind), int(1e3 * length_s)]), stroke.data.time_s
    if what == "rings":
        at_s = float(time_s[stroke.data.raw_force_n.argmax()] + rng.uniform(0.0, RINGS_S))
    else:
        at_s = float(rng.uniform(FIRST_S, LAST_S[what]))
    change = frozen(int(size), at_s, length_s) if what == "frozen" else spiked(FORCE, at_s, length_s, size)
    found = find_reading_faults(Case("glitch", "", trials * [kind], misread=in_trials([PLANTED], change)), seed)
    counts = change(stroke.data, stroke).encoder_count - stroke.data.encoder_count
    misread_rad = float(np.abs(counts * [e.rad_per_count for e in stroke.data.encoders]).max())
    return any(n == PLANTED for _, n, _ in found), sum(n != PLANTED for _, n, _ in found), misread_rad


def main(run: Run) -> bool:
    """Print both tables; whether no sound trial has a finding."""
    keys = [(name, kind, run.seed, run.trials) for kind in run.strokes for name in SOUND]
    alarms = [text for _, found in run.cases(keys, sound) for text in found]
    print("\n".join(alarms))
    print(f"{len(alarms)} false alarms in {len(keys) * run.trials} sound trials")
    sizes = [(what, *spike) for what in ("spike", "rings") for spike in SPIKES]
    sizes += [("frozen", float(i), s) for s in FROZEN_S for i in range(FORCE)]
    asked = [
        (kind, run.seed + k, run.trials, *size) for kind in run.strokes for k in range(run.repeats) for size in sizes
    ]
    outcomes = list(run.cases(asked, planted))
    table, counts = Table("planted:26", "of:5", "found:8", "in other trials:8"), {what: [0, 0] for what, *_ in sizes}
    for what, size, length_s in sizes:
        own = [row for key, row in outcomes if key[3:] == (what, size, length_s)]
        told = [row for row in own if what != "frozen" or row[2] > SEEN_RAD]
        named = ("key", "whippen", "hammer")[int(size)] if what == "frozen" else f"{size:+g} N"
        shown = f"{what} {named}, {1e3 * length_s:g} ms"
        table.row(shown, len(told), sum(row[0] for row in told), sum(row[1] for row in own))
        counts[what] = [counts[what][0] + sum(row[0] for row in told), counts[what][1] + len(told)]
    shares = {what: f"{found} of {of}" for what, (found, of) in counts.items()}
    run.figure(
        "reading-faults",
        f"found: {shares['spike']} spikes of the force, 2 to 6 N for 1 to 15 ms, {shares['rings']} others while the "
        f"key rings on its bed, {shares['frozen']} standstills that misread by 0.5 mrad or more; "
        f"{len(alarms)} false alarms in {len(keys) * run.trials} sound trials",
    )
    return not alarms
