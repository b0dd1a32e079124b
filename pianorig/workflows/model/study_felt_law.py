"""``pianorig study felt-law``: a blow and the touch under each law of felt, and the lines that print such effects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import model
from model.study import Effect, effects_at_equal_loss, felt_law_effects
from pianorig.console.column_file import write_rows
from pianorig.console.output import nan_as_null, print_files
from pianorig.console.progress import working
from pianorig.workflows.model.force_input import read_driving_force

WORDS = {
    "strike_ms": "strike ms",
    "bottom_ms": "bottom ms",
    "free_flight_ms": "free ms",
    "strike_m_per_s": "strike m/s",
    "contact_ms": "contact ms",
    "rebound": "rebound",
    "check_mm": "check mm",
    "down_n": "down N",
    "let_off_n": "let-off N",
    "give_mm": "give mm",
    "peak_n": "peak N",
    "loss_mj": "loss mJ",
    "share": "share",
    "height": "height",
}


def study_felt_law(action: model.Action, force: Path | None, out: Path | None, quiet: bool) -> dict[str, Any]:
    """Simulate, print and write the comparison; force table of a CSV file, by default the built-in forte."""
    times, forces = blow_of(force)
    with working("simulating the blow and a slow press under each law", quiet):
        effects = felt_law_effects(action, times, forces)
    with working("fitting each law to the same peak force and loss", quiet):
        equal = effects_at_equal_loss(action, times, forces)
    rows, equal_rows = effect_rows(effects), effect_rows(equal)
    files: list[Path] = []
    if out is not None:
        files = [out / "felt_law.csv", out / "felt_law_equal_loss.csv"]
        write_rows(files[0], rows)
        write_rows(files[1], equal_rows)
    if not quiet:
        print(f"{action.name}: the law of felt changed, slow loading curves and everything else as they are;")
        print("+- standard uncertainty from the declared numbers of the law")
        print("\n".join(effect_lines(effects)))
        print(
            "\nthe same with equal peak force and equal loss of the felt (the first of all three): what is left is the"
        )
        print(
            "memory's own; share: fitted epsilon or beta, height: of the slow curve; +- from tau or eta, fitted again"
        )
        print("\n".join(effect_lines(equal)))
        print_files(files)
    return {
        "action": action.name,
        "effects": [nan_as_null(row) for row in rows],
        "equal_loss": [nan_as_null(row) for row in equal_rows],
        "files": files,
    }


def blow_of(force: Path | None) -> tuple[Any, Any]:
    """Times and forces of a CSV file or a sealed trial; by default the built-in forte."""
    if force is None:
        return model.force_table("forte")
    driving = read_driving_force(force)
    return driving.time_s, driving.force_n


def effect_rows(effects: Sequence[Effect]) -> list[dict[str, Any]]:
    """One plain row for each effect, values beside their uncertainties."""
    return [
        {"of": e.of, "law": e.law, "held": e.held}
        | {key: number for name in e.value for key, number in ((name, e.value[name]), (f"u_{name}", e.u[name]))}
        for e in effects
    ]


def effect_lines(effects: Sequence[Effect], first: tuple[str, str] = ("felt", "law")) -> list[str]:
    """A table of effects; a dash for what did not happen; ``first`` heads what they are of."""
    names = [name for name in WORDS if name in effects[0].value]
    wide = max(11, *(len(e.of) + 1 for e in effects))
    lines = [f"{first[0]:<{wide}}{first[1]:<14}" + "".join(f"{WORDS[name]:>16}" for name in names) + "  held"]
    for e in effects:
        cells = "".join(f"{_cell(e.value[name], e.u[name]):>16}" for name in names)
        lines.append(f"{e.of:<{wide}}{e.law:<14}{cells}  {'yes' if e.held else 'no'}")
    return lines


def _cell(value: float, u: float) -> str:
    if value != value:
        return "-"
    digits = 4 if abs(value) >= 100.0 else 3
    return f"{value:.{digits}g}" if not u > 1e-6 * abs(value) else f"{value:.{digits}g}+-{u:.1g}"
