"""``pianorig calibrate force``: dead weights, shunt or unloaded reading of the load cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.options import AsJson, Backend, Operator, Rig
from pianorig.console.output import tell
from pianorig.console.terminal import type_answer
from pianorig.errors import CommandInputError


def command(
    out: Annotated[Path, typer.Option("--out", help="Rig file to write, with the values that follow.")],
    weights: Annotated[
        str | None, typer.Option("--weights", help="Masses to hang on the cell, kg, rising: 0.1,0.2,0.5,1.")
    ] = None,
    shunt: Annotated[bool, typer.Option("--shunt", help="Correct the gain by the module's shunt resistor.")] = False,
    null: Annotated[bool, typer.Option("--null", help="Shift the zero to the unloaded reading.")] = False,
    u_mass: Annotated[float, typer.Option("--u-mass", help="Standard uncertainty of a mass, kg.")] = 1e-5,
    gravity: Annotated[
        float | None, typer.Option("--gravity", help="Local g, m/s^2; default 9.80665 with u = 0.015.")
    ] = None,
    rig: Rig = "virtual",
    backend: Backend = "sim://",
    operator: Operator = "unknown",
    as_json: AsJson = False,
) -> None:
    """Calibrate the load cell: weights, shunt or zero.

    The motor stays at 0 V and the drive disabled. A new rig file is written, and a dated record beside it.

    Example:  pianorig calibrate force --weights 0.1,0.2,0.5,1 --out calibrated.toml
    """
    if [weights is not None, shunt, null].count(True) != 1:
        raise CommandInputError("calibrate force: give one of --weights, --shunt and --null")
    if u_mass < 0 or (gravity is not None and not 9.7 < gravity < 9.9):
        raise CommandInputError(f"--u-mass {u_mass:g}, --gravity {gravity}: allowed from 0, and 9.7 to 9.9")
    try:
        masses = tuple(float(cell) for cell in (weights or "").split(",") if cell.strip())
    except ValueError:
        raise CommandInputError(f"--weights {weights}: allowed numbers in kg, separated by commas") from None
    kind = "weights" if weights is not None else "shunt" if shunt else "null"
    order = workflows.CalibrationOrder(kind, masses, u_mass, gravity, operator)
    facts = workflows.calibrate_force(rig, backend, out, order, type_answer)
    tell(as_json, facts, (f"{key:<24} {value}" for key, value in facts.items()))
