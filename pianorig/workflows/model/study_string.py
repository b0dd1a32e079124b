"""``pianorig study string``: an action's hammer on its bar, on a string, on a choir; the action on bar and string."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import model
from model.string import C4, compare_with_bar, hammer_at_the_string
from model.study import string_effects
from pianorig.console.column_file import write_rows
from pianorig.console.output import nan_as_null, print_files
from pianorig.console.progress import working
from pianorig.workflows.model.study_felt_law import blow_of, effect_lines, effect_rows

SHARES = (0.25, 0.5, 1.0, 2.0)  # of the blow's own speed


def study_string(action: model.Action, force: Path | None, out: Path | None, quiet: bool) -> dict[str, Any]:
    """Simulate, print and write the comparison; force table of a CSV file, by default the built-in forte."""
    times, forces = blow_of(force)
    with working("simulating the blow, then bar, string and choir", quiet):
        hammer, speed = hammer_at_the_string(action, times, forces)
        blows = compare_with_bar(hammer, [share * speed for share in SHARES], C4)
        effects = string_effects(action, times, forces)
    rows = [asdict(blow) for blow in blows]
    files: list[Path] = []
    if out is not None:
        files = [out / "string.csv"]
        write_rows(files[0], rows)
        files.append(out / "string_in_the_action.csv")
        write_rows(files[1], effect_rows(effects))
    if not quiet:
        print(f"{action.name}: hammer of {1e3 * hammer.mass_kg:.3g} g at the string, {speed:.3g} m/s under this force;")
        print("bar as in the model, one C4 string, a choir of three 0.5 cents apart, with the felt of contact12")
        print(f"{'':<8}{'speed':>8}{'contact':>9}{'touches':>9}{'peak':>8}{'rebound':>9}{'slope':>11}{'modes':>7}")
        print(f"{'':<8}{'m/s':>8}{'ms':>9}{'':>9}{'N':>8}{'':>9}{'dB/octave':>11}")
        for blow in blows:
            slope = "-" if blow.slope_db_per_octave != blow.slope_db_per_octave else f"{blow.slope_db_per_octave:.1f}"
            print(
                f"{blow.against:<8}{blow.speed_m_per_s:>8.3g}{1e3 * blow.contact_s:>9.2f}{blow.n_contacts:>9}"
                f"{blow.peak_n:>8.3g}{blow.rebound:>9.3f}{slope:>11}{blow.n_modes or '-':>7}"
            )
        print("\nthe whole action under this force; +- from the declared numbers of the string")
        print("\n".join(effect_lines(effects)))
        print_files(files)
    return {
        "action": action.name,
        "hammer_kg": hammer.mass_kg,
        "speed_m_per_s": speed,
        "blows": [nan_as_null(row) for row in rows],
        "in_the_action": [nan_as_null(row) for row in effect_rows(effects)],
        "files": files,
    }
