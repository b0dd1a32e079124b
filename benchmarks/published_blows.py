"""What is published about hammers and strings beside what the model gives: figures that could be read, else trends.

- S. Birkett, Experimental investigation of the piano hammer-string interaction (J. Acoust. Soc. Am., 2013): eight
  levels of impact speed from 1.06 to 2.98 m/s, an upright. Read: the abstract, so the levels alone; here evenly spaced.
- A. Askenfelt, lecture "From touch to string vibrations" (speech.kth.se/music/5_lectures/askenflt), C4 of a grand: the
  contact lasts a few ms and 20 % more or less from piano to fortissimo than at mezzo forte; the key meets its bottom
  after the hammer meets the string in piano, together at about mezzo forte, before it in forte.
- W. Goebl, R. Bresin, A. Galembo, Touch and temporal behavior of grand piano actions (2005), abstract: from finger on
  key to hammer on string, a falling function of the hammer's speed, nearly the same on three pianos, as in Goebl, J.
  Acoust. Soc. Am. 110 (2001) 563, whose power law is 89 ms times (m/s)^-0.57 as remembered; not read.
"""

from __future__ import annotations

import runpy
from typing import Any

import numpy as np

import model
from benchmarks.runner import ROOT, Run, Table
from model.study import measure_blow

STRING: dict[str, Any] = runpy.run_path(str(ROOT / "examples" / "thesis" / "string_blow.py"))
FORCES_N = (1.5, 2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 25.0)
RISE_S = 0.01


def string_table(name: str, hammer: Any, levels: int) -> bool:
    """Contact, touches and spectrum against impact speed; whether contacts grow shorter."""
    print(f"\n{name}")
    table, seen = Table("m/s:6.2f", "contact ms:.2f", "touches:d", "peak N:.1f", "slope dB/octave:.1f"), []
    for speed in np.linspace(1.06, 2.98, levels):
        blow = STRING["strike"](STRING["C4"], hammer, float(speed))
        seen.append(1e3 * blow.contact_s)
        table.row(speed, seen[-1], blow.n_contacts, float(blow.force_n.max()), blow.slope_db_per_octave)
    middle = 0.5 * (seen[0] + seen[-1])
    print(f"contact {100 * (seen[0] / middle - 1):+.0f} and {100 * (seen[-1] / middle - 1):+.0f} % about its middle")
    return seen[-1] < seen[0]


def timing_table() -> float:
    """From force on key to hammer on string, and key bottom against it, over held forces; the exponent."""
    action = model.load_action("hirschkorn2004-regulated")
    print(f"\naction, force risen within {1e3 * RISE_S:g} ms and held; key bottom: front felt pressed with 1 N")
    shown = Table("N:6.1f", "hammer m/s:.2f", "on string ms:.1f", "key bottom, later ms:+.1f")
    speeds, times = [], []
    for force in FORCES_N:
        table = [0.0, 0.02, 0.02 + RISE_S, 0.6], [0.0, 0.0, force, force]
        at = np.arange(0.0, 0.6, 5e-5)
        found = model.simulate(action, *table, output_time_s=at, contact_forces=True)
        marks = measure_blow(action, found, np.interp(at, *table))
        if not marks.strikes:
            shown.row(force, None, None, None)
            continue
        assert found.contact_normal_n is not None
        front = found.contact_normal_n[:, found.contacts.index("contact02")] > 1.0
        bottom = 1e3 * (at[int(np.argmax(front))] - marks.strike_s)
        speeds.append(marks.strike_m_per_s)
        times.append(1e3 * (marks.strike_s - 0.02))
        shown.row(force, speeds[-1], times[-1], bottom)
    power, level = np.polyfit(np.log(speeds), np.log(times), 1)
    print(f"time on string = {np.exp(level):.0f} ms x (m/s)^{power:.2f}")
    return float(power)


def main(run: Run) -> bool:
    """Print the tables; whether contacts grow shorter with speed, and the way to the string falls with it."""
    shorter = string_table(
        "C4 and hammer of Chaigne and Askenfelt, at Birkett's levels", STRING["C4_HAMMER"], run.levels
    )
    action = model.load_action("hirschkorn2004-regulated")
    hammer, _ = STRING["hammer_at_the_string"](action, *model.force_table("forte"))
    shorter &= string_table("C4 and the hammer of the action with the felt of contact12", hammer, run.levels)
    return shorter and timing_table() < 0.0
