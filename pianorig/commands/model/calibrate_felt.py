"""``pianorig calibrate-felt``: parameters of an action from measurements on its parts."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from glob import glob
from pathlib import Path
from typing import Annotated, Any

import typer

import model
from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable
from pianorig.console.options import DEFAULT_ACTION, Action, AsJson
from pianorig.console.output import print_json
from pianorig.console.overrides import read_measured
from pianorig.errors import CommandInputError


def command(
    curves: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="CURVE...",
            help="Loading experiment: CSV with displacement_m,force_n, optionally phase (loading, unloading). "
            "Several, with time_s,displacement_m,force_n: laws of felt compared.",
        ),
    ] = None,
    contact: Annotated[
        str | None, typer.Option("--contact", help="The contact that was measured, for example contact02.")
    ] = None,
    speed: Annotated[str | None, typer.Option("--speed", help="Mean normal speed of a blow, m/s, for D.")] = None,
    force: Annotated[
        list[Path] | None,
        typer.Option("--force", help="Blow to simulate for the mean speeds: CSV with time_s,force_n; may be repeated."),
    ] = None,
    motion: Annotated[
        list[Path] | None,
        typer.Option(
            "--motion", help="Motion for the mean speeds: CSV as simulate --out writes, or measured; may be repeated."
        ),
    ] = None,
    friction: Annotated[
        tuple[str, str] | None, typer.Option("--friction", help="Static and kinetic coefficient: MU_S MU_K.")
    ] = None,
    rebound: Annotated[
        tuple[str, str] | None,
        typer.Option("--rebound", help="Hammer head's speed before and after the string, m/s: gives D of contact12."),
    ] = None,
    pendulum: Annotated[
        tuple[str, str, str] | None,
        typer.Option("--pendulum", help="MASS ARM PERIOD, kg, m and s: gives the inertia of --body."),
    ] = None,
    body: Annotated[str | None, typer.Option("--body", help="The body that swung as a pendulum.")] = None,
    action: Action = DEFAULT_ACTION,
    figure: Annotated[Path | None, typer.Option("--figure", help="Draw curve and fit: .svg, .pdf or .png.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="TOML file to write: the action with what was calibrated.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate felt, friction, string damping and inertia.

    Eqs 2.5 and 2.7 for felt, 2.10 for friction, A.1 and A.2 for inertia.

    A measured number may carry its standard uncertainty, 0.35+-0.01; with --out it must.

    Several curves at several speeds and peak forces: each law of felt is fitted to them and judged by curves left out.

    Example:  pianorig calibrate-felt felt.csv --contact contact02 --force force.csv --figure felt.svg --out mine.toml
    """
    if figure is not None:
        if not curves:
            raise CommandInputError("--figure: draws a loading experiment; name its CSV file too")
        check_writable(figure, *FIGURE_ENDINGS)
    if out is not None:
        check_writable(out, ".toml")
    curves = _named(curves or [])
    given = model.load_action(action)
    blows, speeds = workflows.blow_speeds(given, force or [], motion or [])
    if not curves and not blows and friction is None and rebound is None and pendulum is None:
        raise CommandInputError(
            "nothing to calibrate; name a loading experiment, or give --friction, --rebound or --pendulum"
        )
    facts: dict[str, Any] = {"action": given.name, **speeds.facts}
    lines = list(speeds.lines)
    found = []  # what each measurement gave, and the source its values get in the action's file
    if curves and len(curves) > 1:
        if speed is not None or blows:
            raise CommandInputError(
                "--speed, --force, --motion: D of one curve; several curves give D from their own speeds"
            )
        felt = workflows.felt_laws(given, curves, contact, figure)
        facts["felt_laws"] = felt.facts
        found.append((felt, f"calibrated from {len(curves)} presses, {curves[0].name} first"))
    elif curves:
        felt = workflows.felt(given, curves[0], contact, speed, blows, figure)
        facts["felt"] = felt.facts
        found.append((felt, f"calibrated from {curves[0].name}"))
    for name, texts, calibrate in (
        ("friction", friction, partial(workflows.friction, contact)),
        ("rebound", rebound, workflows.rebound),
        ("pendulum", pendulum, partial(workflows.pendulum, given, body)),
    ):
        if texts is not None:
            measured = [read_measured(text, f"--{name}") for text in texts]
            if out is not None and any(u is None for _, u in measured):
                raise CommandInputError(
                    f"--{name} {' '.join(texts)}: without uncertainty; {out} needs one, as in {texts[0]}+-0.01"
                )
            part = calibrate([v for v, _ in measured], [u or 0.0 for _, u in measured])
            facts[name] = part.facts
            found.append((part, f"calibrated from {name} {' '.join(texts)}"))
    calibrated = given
    for part, source in found:
        lines += part.lines
        calibrated = model.calibration.with_calibrated(calibrated, part.values, source)
    if out is not None:
        changed = sum(len(part.values) for part, _ in found)
        if not changed:
            raise CommandInputError(f"{out}: nothing to write; name with --contact or --body what was measured")
        name = f"{given.name}-calibrated"
        heading = [f"{name}: {given.name} with values calibrated by `pianorig calibrate-felt`."]
        model.write_action(replace(calibrated, name=name), out, heading)
        facts["out"] = out
        lines.append(f"{out}: {name}, {changed} values changed")
    if as_json:
        print_json(facts)
        return
    print("\n".join(lines))


def _named(curves: list[Path]) -> list[Path]:
    """Files of a pattern such as ``presses/*.csv``, which Windows shells hand on as it stands."""
    found = ([curve] if curve.exists() else sorted(map(Path, glob(str(curve)))) or [curve] for curve in curves)
    return [one for files in found for one in files]
