"""Forte, piano and double blows against two calibrations of the damping: thesis Figs 4.1 to 4.15 in one report.

Run:  python examples/thesis_chapter_4.py [FOLDER]

Uses the virtual bench; to use your own sessions, pass their folders instead.  The damping for soft blows is 4.5 times
that for a forte blow, the middle of the "four to five times" of the thesis.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import model
import rig
import validation

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
sessions = [
    rig.record(folder / profile, profile=profile, trials=2, backend="sim://", operator="example")
    for profile in ("forte", "piano", "double")
]

printed = model.load_action("hirschkorn2004")
damping = [path for path in printed.quantities if path.endswith(".normal.D")]
softer = replace(printed.with_values({path: 4.5 * printed[path] for path in damping}), name="damping x 4.5")

side = validation.validate_sessions(sessions, [printed, softer], folder / "report", budget=False, explain=False)
scores = side.tables["scorecard"].query("score == 'rmse_rad'")
print(scores.pivot_table("value", ["session", "model"], "channel").to_string())
for line in side.verdict_lines:
    print("-", line)
print("report:", side.files["report.html"])
