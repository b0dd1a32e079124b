"""``pianorig study joints``: a blow with joints that give, one at a time and together, and over their stiffness."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import model
from model.study import joint_effects, joint_sweep
from pianorig.console.column_file import write_rows
from pianorig.console.output import nan_as_null, print_files
from pianorig.console.progress import working
from pianorig.workflows.model.study_felt_law import WORDS, blow_of, effect_lines, effect_rows

SWEPT = ("strike_ms", "bottom_ms", "free_flight_ms", "strike_m_per_s", "rebound", "check_mm", "give_mm")


def study_joints(action: model.Action, force: Path | None, out: Path | None, quiet: bool) -> dict[str, Any]:
    """Simulate, print and write the comparison; force table of a CSV file, by default the built-in forte."""
    times, forces = blow_of(force)
    with working("simulating the blow with joints that give", quiet):
        effects = joint_effects(action, times, forces)
        swept = [{"factor": factor, **marks} for factor, marks in joint_sweep(action, times, forces).items()]
    rows = effect_rows(effects)
    files: list[Path] = []
    if out is not None:
        files = [out / "joints.csv", out / "joints_stiffness.csv"]
        write_rows(files[0], rows)
        write_rows(files[1], swept)
    if not quiet:
        print(
            f"{action.name}: joints that give, everything else as it is; their numbers are guesses, a stiffness within"
        )
        print("a factor of five: +- standard uncertainty from these guesses")
        print("\n".join(effect_lines(effects, ("joint", ""))))
        print("\nall five, their stiffness times a factor (dampings times its root)")
        print(f"{'factor':<8}" + "".join(f"{WORDS[name]:>12}" for name in SWEPT) + "  held")
        for row in swept:
            head = f"{row['factor']:g}" if row["factor"] else "rigid"
            cells = "".join(f"{row[name]:>12.4g}" for name in SWEPT)
            print(f"{head:<8}{cells}  {'yes' if row['held'] else 'no'}")
        print(
            "\nThe thesis (5.2): bushings 'were modelled as perfect revolute joints, though it is known that there is"
        )
        print("some movement'; the key's on its rail 'caused a noticeable discrepancy in the key position measurement'")
        print_files(files)
    return {
        "action": action.name,
        "effects": [nan_as_null(row) for row in rows],
        "stiffness": [nan_as_null(row) for row in swept],
        "files": files,
    }
