"""``pianorig calibrate-felt``: parameters of an action from measurements on its parts."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pianorig.console.overrides import read_measured

if TYPE_CHECKING:
    from model import Action
    from model.calibration import MeanSpeeds

STRING = "contact12"
THESIS_RATIO = "four to five times"

Values = dict[str, tuple[float, float]]  # path -> value and standard uncertainty
Found = tuple[dict[str, Any], list[str], Values]  # what a job gives: JSON, lines to print, values for the file


def command(
    curve: Annotated[
        Path | None,
        typer.Argument(
            help="Loading experiment: CSV with displacement_m,force_n, optionally phase (loading, unloading)."
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
    action: Annotated[str, typer.Option("--action", help="Built-in action or a TOML file.")] = "hirschkorn2004",
    figure: Annotated[Path | None, typer.Option("--figure", help="Draw curve and fit: .svg, .pdf or .png.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="TOML file to write: the action with what was calibrated.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Calibrate felt (eqs 2.5, 2.7), friction (eq. 2.10), the string's damping and inertia (eqs A.1, A.2).

    A measured number may carry its standard uncertainty, 0.35+-0.01; with --out it must.

    Example:  pianorig calibrate-felt felt.csv --contact contact02 --force forte.csv --figure felt.svg --out mine.toml
    """
    import model
    from model.calibration import with_calibrated
    from model.files.figure_sheet import check_ending
    from model.regulation import write_action
    from pianorig.console.output import check_writable, print_json
    from pianorig.errors import InputError

    if figure is not None:
        if curve is None:
            raise InputError("--figure: draws a loading experiment; name its CSV file too")
        check_ending(figure)
        check_writable(figure)
    if out is not None:
        if out.suffix != ".toml":
            raise InputError(f"{out}: ending found {out.suffix!r}, allowed .toml")
        check_writable(out)
    given = model.load_action(action)
    blows = _blows(given, force or [], motion or [])
    if curve is None and not blows and friction is None and rebound is None and pendulum is None:
        raise InputError("nothing to calibrate; name a loading experiment, or give --friction, --rebound or --pendulum")
    facts: dict[str, Any] = {"action": given.name}
    done, changed = given, 0
    lines: list[str] = []
    if blows:
        facts["blows"] = _speeds_json(blows)
        lines += _speed_table(blows)
    if curve is not None:
        facts["felt"], said, new = _felt(given, curve, contact, speed, blows, figure)
        lines += said
        done, changed = with_calibrated(done, new, f"calibrated from {curve.name}"), changed + len(new)
    for name, texts, job in (
        ("friction", friction, partial(_friction, contact)),
        ("rebound", rebound, _rebound),
        ("pendulum", pendulum, partial(_pendulum, given, body)),
    ):
        if texts is not None:
            measured = [read_measured(text, f"--{name}") for text in texts]
            if out is not None and any(u is None for _, u in measured):
                raise InputError(
                    f"--{name} {' '.join(texts)}: without uncertainty; {out} needs one, as in {texts[0]}+-0.01"
                )
            facts[name], said, new = job([v for v, _ in measured], [u or 0.0 for _, u in measured])
            lines += said
            done, changed = with_calibrated(done, new, f"calibrated from {name} {' '.join(texts)}"), changed + len(new)
    if out is not None:
        if not changed:
            raise InputError(f"{out}: nothing to write; name with --contact or --body what was measured")
        done = replace(done, name=f"{given.name}-calibrated")
        write_action(done, out, [f"{done.name}: {given.name} with values calibrated by `pianorig calibrate-felt`."])
        facts["out"] = out
        lines.append(f"{out}: {done.name}, {changed} values changed")
    if as_json:
        print_json(facts)
        return
    print("\n".join(lines))


def _blows(given: Action, forces: list[Path], motions: list[Path]) -> dict[str, MeanSpeeds]:
    """Mean speeds by name of the file they come from."""
    import model
    from model.calibration import mean_normal_speeds, read_motion
    from pianorig.errors import InputError

    blows: dict[str, MeanSpeeds] = {}
    for path in [*forces, *motions]:
        if path.stem in blows:
            raise InputError(f"{path}: a blow named {path.stem} is there already; rename the file")
        if path in forces:
            seen = model.simulate(given, *model.read_force_table(path))
            moved = (seen.time_s, seen.angle_rad, seen.speed_rad_per_s)
        else:
            moved = read_motion(path)
        blows[path.stem] = mean_normal_speeds(given, *moved)
    return blows


def _speeds_json(blows: dict[str, MeanSpeeds]) -> dict[str, Any]:
    return {
        blow: {
            name: {"mean_normal_speed_m_per_s": v if v == v else None, "counted_s": t}
            for name, v, t in zip(m.contacts, m.speed_m_per_s.tolist(), m.counted_s.tolist(), strict=True)
        }
        for blow, m in blows.items()
    }


def _speed_table(blows: dict[str, MeanSpeeds]) -> list[str]:
    """Mean speeds, and with two blows what that means for D."""
    from model.calibration.speeds import REST_SHARE

    first, *others = blows
    lines = [
        f"mean normal speed while pressed and faster than {REST_SHARE:.0%} of the contact's largest, m/s",
        f"{'':<11}" + "".join(f" {b:>12}" for b in blows) + "".join(f"  {f'D {b}/{first}':>22}" for b in others),
    ]
    base = blows[first].speed_m_per_s
    for k, name in enumerate(blows[first].contacts):
        row = "".join(_cell(m.speed_m_per_s[k], 13) for m in blows.values())
        lines.append(f"{name:<11}{row}" + "".join(_cell(base[k] / blows[b].speed_m_per_s[k], 24) for b in others))
    if others:
        lines.append(f"the thesis (Section 4.2.2) found D of its piano blow {THESIS_RATIO} that of its forte blow")
    return lines


def _cell(value: float, width: int) -> str:
    return f"{f'{value:.3g}' if value == value else '-':>{width}}"


def _felt(
    given: Action,
    path: Path,
    contact: str | None,
    speed: str | None,
    blows: dict[str, MeanSpeeds],
    figure: Path | None,
) -> Found:
    from model.calibration import damping_factor, fit_felt, read_curve
    from pianorig.errors import InputError

    if contact is not None and f"{contact}.normal.a" not in given.quantities:
        raise InputError(f"--contact {contact}: not found; allowed contact01 to contact13")
    if blows and contact is None:
        raise InputError("--contact: missing; it says whose mean speed in the blow counts")
    curve = read_curve(path)
    fit = fit_felt(curve)
    speeds = {} if speed is None else {"--speed": read_measured(speed, "--speed")}
    speeds |= {blow: (m.of(contact), None) for blow, m in blows.items() if contact is not None}
    dampings = {blow: damping_factor(fit, v, u or 0.0) for blow, (v, u) in speeds.items()}
    lines = [f"{path}: {contact or 'felt'}, {1e3 * fit.measured_m[0]:.3g} to {1e3 * fit.measured_m[1]:.3g} mm"]
    for name, unit, v, u in zip("abc", ("N/m^3", "N/m^2", "N/m"), fit.abc, fit.u_abc, strict=True):
        lines.append(f"  {name} = {v:.4g}  u {u:.2g}  {unit}")
    lines.append(f"  mid-line off the cubic: {fit.misfit_n:.3g} N rms of {fit.mid_n[-1]:.3g} N")
    if fit.bound is not None:
        lines.append(f"  the fit lies on a bound of what a felt can do: {fit.bound}; look at the figure")
    for blow, one in dampings.items():
        lines.append(
            f"  D = {one.d:.4g}  u {one.u_d:.2g}  s/m  ({blow}: {one.speed_m_per_s:.4g} m/s; taken at "
            f"{1e3 * one.at_m:.3g} mm)"
        )
    if figure is not None:
        from model.calibration.figure import draw

        draw(curve, fit, dampings, contact or path.stem, figure)
        lines.append(f"  {figure}")
    facts = {
        "file": path,
        "contact": contact,
        "abc": fit.abc,
        "u_abc": fit.u_abc,
        "covariance": fit.covariance,
        "measured_m": fit.measured_m,
        "misfit_n": fit.misfit_n,
        "bound": fit.bound,
        "D": {b: {"d": o.d, "u": o.u_d, "at_m": o.at_m, "speed_m_per_s": o.speed_m_per_s} for b, o in dampings.items()},
        "figure": figure,
    }
    values: Values = {}
    if contact is not None:
        values = {
            f"{contact}.normal.{k}": (float(v), float(u)) for k, v, u in zip("abc", fit.abc, fit.u_abc, strict=True)
        }
        if dampings:
            first = next(iter(dampings.values()))
            values[f"{contact}.normal.D"] = (first.d, first.u_d)
    return facts, lines, values


def _friction(contact: str | None, mu: list[float], u: list[float]) -> Found:
    from model.calibration import fit_friction

    fit = fit_friction(*mu, *u)
    facts = {"A": fit.a, "B1": fit.b1, "B2": fit.b2, "u_A": fit.u_a, "u_B1": fit.u_b1}
    lines = [
        f"friction {contact or ''}: A = {fit.a:.4g}  u {fit.u_a:.2g}, B1 = {fit.b1:.4g}  u {fit.u_b1:.2g}, "
        f"B2 = {fit.b2:g} (eq. 2.10)"
    ]
    law = f"{contact}.friction"
    if contact is None:
        return facts, lines, {}
    return facts, lines, {f"{law}.A": (fit.a, fit.u_a), f"{law}.B1": (fit.b1, fit.u_b1), f"{law}.B2": (fit.b2, 0.0)}


def _rebound(speeds: list[float], u: list[float]) -> Found:
    from model.calibration import damping_from_rebound

    d, u_d = damping_from_rebound(*speeds, *u)
    return {"D": d, "u_D": u_d}, [f"string {STRING}: D = {d:.4g}  u {u_d:.2g}  s/m"], {f"{STRING}.normal.D": (d, u_d)}


def _pendulum(given: Action, body: str | None, swing: list[float], u: list[float]) -> Found:
    from model import BODIES
    from model.calibration import inertia_from_pendulum
    from pianorig.errors import InputError

    if body is not None and body not in BODIES:
        raise InputError(f"--body {body}: not found; allowed {', '.join(BODIES)}")
    found = inertia_from_pendulum(*swing, u_mass_kg=u[0], u_arm_m=u[1], u_period_s=u[2], g=given["gravity.g"])
    facts = {
        "about_pivot_kg_m2": found.about_pivot,
        "about_center_kg_m2": found.about_center,
        "u_about_pivot_kg_m2": found.u_about_pivot,
        "u_about_center_kg_m2": found.u_about_center,
    }
    lines = [
        f"inertia {body or ''}: {found.about_pivot:.4g}  u {found.u_about_pivot:.2g}  kg m^2 about the pivot, "
        f"{found.about_center:.4g}  u {found.u_about_center:.2g}  about the centre of mass"
    ]
    return facts, lines, {} if body is None else {f"{body}.inertia": (found.about_center, found.u_about_center)}
