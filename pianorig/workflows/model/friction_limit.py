"""``pianorig study friction-limit``: what the threshold speed of eq. 2.10 does, beside set-valued friction."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import model
from model.stick_slip import Limit, compare
from model.stick_slip.figure import draw
from pianorig.console.column_file import write_rows
from pianorig.console.output import nan_as_null, print_files
from pianorig.console.progress import working
from pianorig.workflows.model.force_input import read_driving_force

_HEAD = ("friction", "strike", "speed", "hold", "moves in it", "differs by", "until release")
_UNITS = ("", "ms", "m/s", "mm", "mm/s", "rad", "rad")


def friction_limit(action: model.Action, force: Path | None, out: Path | None, quiet: bool) -> dict[str, Any]:
    """Simulate, print and write the comparison; force table of a CSV file, by default the built-in forte."""
    if force is None:
        times, forces = model.force_table("thesis-forte")
    else:
        driving = read_driving_force(force)
        times, forces = driving.time_s, driving.force_n
    with working("integrating with falling threshold speeds, then with set-valued friction", quiet):
        limit = compare(action, times, forces)
    rows = _rows(limit)
    files: list[Path] = []
    if out is not None:
        files = [out / "friction_limit.svg", out / "friction_limit.csv"]
        draw(limit, files[0])
        write_rows(files[1], rows)
    if not quiet:
        _print(action, limit, rows)
        print_files(files)
    plain = [nan_as_null(row) for row in rows]
    return {"action": action.name, "march_error_rad": limit.march_error_rad, "friction": plain, "files": files}


def _rows(limit: Limit) -> list[dict[str, Any]]:
    rows = []
    names = [f"v_t {v:g} m/s" for v in limit.v_t] + ["set-valued"]
    for name, solution, m in zip(names, (*limit.smoothed, limit.marched.solution), limit.measures, strict=True):
        rows.append(
            {
                "friction": name,
                "strike_s": m.strike_s,
                "strike_m_per_s": m.strike_m_per_s,
                "held": m.held,
                "hold_m": m.hold_m,
                "creep_m_per_s": limit.creep_m_per_s(solution),
                "differs_rad": limit.away_rad(solution),
                "differs_until_release_rad": limit.away_until_release_rad(solution),
            }
        )
    return rows


def _print(action: model.Action, limit: Limit, rows: list[dict[str, Any]]) -> None:
    print(f"{action.name}: eq. 2.10 with falling threshold speed, and set-valued friction in steps of")
    print(f"{1e6 * limit.marched.step_s:g} us (its own error, step halved: {limit.march_error_rad:.1e} rad)")
    for line in (_HEAD, _UNITS):
        print(f"{line[0]:<14}" + "".join(f"{word:>14}" for word in line[1:]))
    for row in rows:
        numbers = (
            f"{1e3 * row['strike_s']:.4f}",
            f"{row['strike_m_per_s']:.5f}",
            f"{1e3 * row['hold_m']:.4f}" + ("" if row["held"] else "*"),
            f"{1e3 * row['creep_m_per_s']:+.4f}",
            f"{row['differs_rad']:.1e}",
            f"{row['differs_until_release_rad']:.1e}",
        )
        print(f"{row['friction']:<14}" + "".join(f"{number:>14}" for number in numbers))
    if not all(row["held"] for row in rows):
        print("* not held by the back check")
