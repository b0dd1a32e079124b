"""``pianorig calibrate drive``: a bench's motor, amplifier and arm from a log of command, force and motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import model
from model.parameters.effects import effect_defaults
from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable
from pianorig.console.options import AsJson, Figure
from pianorig.console.output import file_lines, tell
from pianorig.console.overrides import read_measured
from pianorig.errors import CommandInputError
from rig.atomic_write import write_text

SUM = "resistance_and_loop_gain"


def command(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG",
            help="CSV with time_s,command_v,force_n,arm_rad, and current_a where it was recorded; equal intervals.",
        ),
    ],
    mode: Annotated[
        str, typer.Option("--mode", help="What the command asks the amplifier for: torque or voltage.")
    ] = "torque",
    length: Annotated[str, typer.Option("--length", help="Lever of the arm's tip, m.")] = "0.100+-0.0003",
    known: Annotated[
        list[str] | None,
        typer.Option("--known", help="Of the data sheet, e.g. current_gain=2.0+-0.02; may be repeated."),
    ] = None,
    u_force: Annotated[
        float, typer.Option("--u-force", help="Relative standard uncertainty of the force's scale.")
    ] = 5e-3,  # choice: a clamp of half a per cent
    u_current: Annotated[
        float, typer.Option("--u-current", help="The same of the current's scale.")
    ] = 5e-3,  # as above
    u_delay: Annotated[
        float, typer.Option("--u-delay", help="Standard uncertainty of the time from command to force, s.")
    ] = 1e-5,  # V: choice
    out: Annotated[Path | None, typer.Option("--out", help="Scene with the drive as found, .toml.")] = None,
    figure: Figure = None,
    as_json: AsJson = False,
) -> None:
    """Identify the motor's drive from a log of the bench.
    Resistance, inductance, torque constant, gains, limits and the arm's inertia, each with its standard uncertainty;
    numbers that the log does not determine are named, with what would settle them. With --out a scene file is written.

    Example:  pianorig calibrate drive drive_log.csv --known torque_constant=0.6+-0.006 --out my_drive.toml
    """
    check_writable(out, ".toml")
    check_writable(figure, *FIGURE_ENDINGS)
    options = _drive_options(mode, length, known or [], (u_force, u_current, u_delay))
    found = model.drive.identify_drive(model.drive.read_drive_log(log), options)
    lines = found.lines()
    if out is not None:
        write_text(out, scene_text(found, options.length_m))
        lines.append(f"{out}: the drive as found, for --scene")
    items = (*found.drive, *found.combinations, *found.arm)
    facts = {
        "mode": found.mode,
        "determined": {e.name: {"value": e.value, "u": e.u, "unit": e.unit} for e in items if e.is_determined},
        "not_determined": {e.name: e.why for e in items if not e.is_determined},
        "rms_nm": found.rms_nm,
    }
    if figure is not None:
        workflows.draw_uncertainties(items, figure)
    tell(as_json, facts | {"figure": figure}, (*lines, *file_lines([figure])))


def _drive_options(mode: str, length: str, known: list[str], u: tuple[float, float, float]) -> model.drive.DriveOptions:
    """Options of the identification from texts: ``length`` (m) as VALUE or VALUE+-U, ``known`` each as NAME=VALUE+-U;
    ``u``: standard uncertainties of force (N), current (A) and delay (s)."""
    values = {}
    for text in known:
        name, sign, value = text.partition("=")
        found, u_found = read_measured(value, f"--known {name}") if sign else (0.0, None)
        if u_found is None:
            raise CommandInputError(f"--known {text!r}: allowed NAME=VALUE+-U, as in current_gain=2.0+-0.02")
        values[name] = (found, u_found)
    length_m, u_length = read_measured(length, "--length")
    return model.drive.DriveOptions(mode, length_m, u_length or 0.0, *u, known=values)


def _format_uncertainty(e: model.drive.Estimate) -> str:
    return f"standard uncertainty {e.u:.2g} {e.unit}"


def scene_text(found: model.drive.DriveIdentified, length_m: float) -> str:
    """Text of a scene file (TOML) with the parameters of arm and drive that were determined and the arm's length; a
    line says why another was not, which then keeps the built-in value."""
    arm, drive = ["[motor_arm]", f"length = {length_m!r}"], ["[motor_drive]"]
    for name in ("inertia", "joint_friction", "spring_stiffness"):
        e = found[name]
        if e.is_determined and e.value > e.u:
            arm.append(f"{name} = {e.value!r}  # {_format_uncertainty(e)}")
    for e in (e for e in found.drive if e.name != SUM):
        drive.append(
            f"{e.name} = {e.value!r}  # {_format_uncertainty(e)}" if e.is_determined else f"# {e.name}: {e.why}"
        )
    if found.mode == "voltage":
        drive += ["current_gain = 0.0", "loop_gain = 0.0"]
    elif found[SUM].is_determined and not found["loop_gain"].is_determined:
        assumed = effect_defaults()["motor_drive.resistance"].value
        drive += [f"resistance = {assumed!r}  # assumed; of both together the log says {found[SUM].value:.4g} V/A"]
        drive += [f"loop_gain = {found[SUM].value - assumed!r}"]
    return "\n".join(["# by pianorig calibrate drive", *arm, "", *drive]) + "\n"
