"""``pianorig calibrate-drive``: a bench's motor, amplifier and arm from a log of command, force and motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianorig import workflows
from pianorig.console.column_file import check_writable
from pianorig.console.options import DEFAULT_ACTION, Action, AsJson
from pianorig.console.output import print_json
from pianorig.errors import CommandInputError


def command(
    log: Annotated[
        Path | None,
        typer.Argument(
            metavar="LOG",
            help="CSV with time_s,command_v,force_n,arm_rad, and current_a where it was recorded; equal intervals.",
        ),
    ] = None,
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
    ] = 5e-3,
    u_current: Annotated[float, typer.Option("--u-current", help="The same of the current's scale.")] = 5e-3,
    u_delay: Annotated[
        float, typer.Option("--u-delay", help="Standard uncertainty of the time from command to force, s.")
    ] = 1e-5,
    rehearse: Annotated[
        str | None,
        typer.Option(
            "--rehearse", help="Instead of a log: what a log of this scene's drive would tell, e.g. motor-drive."
        ),
    ] = None,
    current: Annotated[bool, typer.Option(help="Whether a rehearsed log holds the current.")] = True,
    action: Action = DEFAULT_ACTION,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Scene with the drive as found, .toml; of a rehearsal the log, .csv."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Identify the motor's drive from a log of the bench.

    Resistance, inductance, torque constant, gains, limits and the arm's inertia, each with its standard uncertainty;
    numbers that the log does not determine are named, with what would settle them.

    Example:  pianorig calibrate-drive --rehearse motor-drive
    """
    if (log is None) == (rehearse is None):
        raise CommandInputError("calibrate-drive: found neither a log nor --rehearse, or both; give one of them")
    if out is not None:
        check_writable(out, ".csv" if log is None else ".toml")
    order = workflows.DriveOrder(mode, length, tuple(known or ()), u_force, u_current, u_delay)
    if log is None:
        assert rehearse is not None
        told = workflows.rehearse_drive(action, rehearse, order, current, out)
    else:
        told = workflows.identify_drive(log, order, out)
    if as_json:
        print_json(told.facts)
        return
    print("\n".join(told.lines))
    if out is not None:
        print(f"{out}: {'the drive as found, for --scene' if log is not None else 'the log'}")
