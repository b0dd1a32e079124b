"""``pianorig calibrate felt``: parameters of an action from measurements on its parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from glob import glob
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer

import model
from pianorig import workflows
from pianorig.console.column_file import FIGURE_ENDINGS, check_writable
from pianorig.console.options import DEFAULT_ACTION, Action, AsJson
from pianorig.console.output import tell
from pianorig.console.overrides import read_measured
from pianorig.errors import CommandInputError

STRING = "contact12"
THESIS_RATIO = "four to five times"
THESIS_LAW = "hunt-crossley"
FEWEST_PRESSES = 3  # a law's loss, its speed and its depth each need one


def command(
    curves: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="CURVE...",
            help="Loading experiment: CSV with displacement_m,force_n, optionally phase (loading, unloading). "
            "Several, with time_s,displacement_m,force_n: each law of felt is fitted.",
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
    What is found is printed; with --out an action with these values is written. Eqs 2.5 and 2.7 for felt, 2.10 for
    friction, A.1 and A.2 for inertia.

    A measured number may carry its standard uncertainty, 0.35+-0.01; with --out it must.

    Several curves at several speeds and peak forces: each law of felt is fitted to them, with its error on curves held
    out. Which laws they rule out: examples/felt_laws.py.

    Example:  pianorig calibrate felt felt.csv --contact contact02 --force force.csv --figure felt.svg --out mine.toml
    """
    if figure is not None and not curves:
        raise CommandInputError("--figure: draws a loading experiment; name its CSV file too")
    check_writable(figure, *FIGURE_ENDINGS)
    check_writable(out, ".toml")
    curves = expand_patterns(curves or [])
    given = model.load_action(action)
    if curves and contact is not None and f"{contact}.normal.a" not in given.quantities:
        raise CommandInputError(f"--contact {contact}: not found; allowed contact01 to contact13")
    blows, speeds = _blow_speeds(given, force or [], motion or [])
    if not curves and not blows and friction is None and rebound is None and pendulum is None:
        raise CommandInputError(
            "nothing to calibrate; name a loading experiment, or give --friction, --rebound or --pendulum"
        )
    found = []  # name of each measurement, what it gave, and the source its values get in the action's file
    if curves and len(curves) > 1:
        if speed is not None or blows:
            raise CommandInputError(
                "--speed, --force, --motion: D of one curve; several curves give D from their own speeds"
            )
        source = f"calibrated from {len(curves)} presses, {curves[0].name} first"
        found.append(("felt_laws", _fit_felt_laws(curves, contact, figure), source))
    elif curves:
        felt = _fit_felt(curves[0], contact, speed, blows, figure)
        found.append(("felt", felt, f"calibrated from {curves[0].name}"))
    for name, texts, calibrate in (
        ("friction", friction, partial(_calibrate_friction, contact)),
        ("rebound", rebound, _calibrate_rebound),
        ("pendulum", pendulum, partial(_calibrate_pendulum, given, body)),
    ):
        if texts is not None:
            measured = [read_measured(text, f"--{name}") for text in texts]
            if out is not None and any(u is None for _, u in measured):
                raise CommandInputError(
                    f"--{name} {' '.join(texts)}: without uncertainty; {out} needs one, as in {texts[0]}+-0.01"
                )
            part = calibrate([v for v, _ in measured], [u or 0.0 for _, u in measured])
            found.append((name, part, f"calibrated from {name} {' '.join(texts)}"))
    facts: dict[str, Any] = {"action": given.name, **speeds.facts}
    lines, calibrated = list(speeds.lines), given
    for name, part, source in found:
        facts[name] = part.facts
        lines += part.lines
        calibrated = model.calibration.with_calibrated(calibrated, part.values, source)
    if out is not None:
        changed = sum(len(part.values) for _, part, _ in found)
        if not changed:
            raise CommandInputError(f"{out}: nothing to write; name with --contact or --body what was measured")
        name = f"{given.name}-calibrated"
        heading = [f"{name}: {given.name} with values calibrated by `pianorig calibrate felt`."]
        model.write_action(replace(calibrated, name=name), out, heading)
        facts["out"] = out
        lines.append(f"{out}: {name}, {changed} values changed")
    tell(as_json, facts, lines)


def expand_patterns(curves: list[Path]) -> list[Path]:
    """Files of a pattern such as ``presses/*.csv``, which Windows shells hand on as it stands."""
    found = ([curve] if curve.exists() else sorted(map(Path, glob(str(curve)))) or [curve] for curve in curves)
    return [one for files in found for one in files]


class Calibrated(NamedTuple):
    """What a measurement gives."""

    facts: dict[str, Any]
    """For JSON."""
    lines: list[str]
    """To print."""
    values: dict[str, tuple[float, float]]
    """Path to value and standard uncertainty, for the action's file; empty where the part is not named."""


def _blow_speeds(
    action: model.Action, forces: Sequence[Path], motions: Sequence[Path]
) -> tuple[dict[str, model.calibration.MeanSpeeds], Calibrated]:
    """Mean normal speed of every contact in each blow, by the name of its file: simulated from force tables, or read
    from tables of motion; then the same as facts and lines to print."""
    blows: dict[str, model.calibration.MeanSpeeds] = {}
    for path in [*forces, *motions]:
        if path.stem in blows:
            raise CommandInputError(f"{path}: a blow named {path.stem} is there already; rename the file")
        moved: tuple[Any, ...]
        if path in forces:
            driving = workflows.read_driving_force(path)
            rest = driving.rest(action, model.choice_of(action))
            seen = model.simulate(action, driving.time_s, driving.force_n, initial=rest)
            moved = (seen.time_s, seen.angle_rad, seen.speed_rad_per_s)
        else:
            moved = model.calibration.read_motion(path)
        blows[path.stem] = model.calibration.mean_normal_speeds(action, *moved)
    if not blows:
        return blows, Calibrated({}, [], {})
    facts = {
        blow: {
            name: {"mean_normal_speed_m_per_s": v, "counted_s": t}
            for name, v, t in zip(m.contacts, m.speed_m_per_s.tolist(), m.counted_s.tolist(), strict=True)
        }
        for blow, m in blows.items()
    }
    return blows, Calibrated({"blows": facts}, _speed_table(blows), {})


def _speed_table(blows: dict[str, model.calibration.MeanSpeeds]) -> list[str]:
    """Lines of a table: mean normal speed, m/s, at each contact in each blow, and the first blow's over each other's,
    which is the ratio of their damping factors D."""
    first, *others = blows
    lines = [
        f"mean normal speed while pressed and faster than {model.calibration.REST_SHARE:.0%} of the contact's largest, "
        "m/s",
        f"{'':<11}" + "".join(f" {b:>12}" for b in blows) + "".join(f"  {f'D {b}/{first}':>22}" for b in others),
    ]
    base = blows[first].speed_m_per_s
    for k, name in enumerate(blows[first].contacts):
        row = "".join(_cell(m.speed_m_per_s[k], 13) for m in blows.values())  # columns
        ratios = "".join(_cell(base[k] / blows[b].speed_m_per_s[k], 24) for b in others)  # columns
        lines.append(f"{name:<11}{row}{ratios}")
    if others:
        lines.append(f"the thesis (Section 4.2.2) found D of its piano blow {THESIS_RATIO} that of its forte blow")
    return lines


def _cell(value: float, width: int) -> str:
    return f"{f'{value:.3g}' if value == value else '-':>{width}}"


def _fit_felt(
    path: Path,
    contact: str | None,
    speed: str | None,
    blows: dict[str, model.calibration.MeanSpeeds],
    figure: Path | None,
) -> Calibrated:
    """Fit the felt's cubic to a loading experiment, and its damping factor D at ``speed`` (text, m/s) and at the
    contact's mean speed in each blow; facts, lines, and parameter values with u where a contact is named."""
    if blows and contact is None:
        raise CommandInputError("--contact: missing; it says whose mean speed in the blow counts")
    curve = model.calibration.read_curve(path)
    fit = model.calibration.fit_felt(curve)
    speeds = {} if speed is None else {"--speed": read_measured(speed, "--speed")}
    speeds |= {blow: (m.mean_speed(contact), None) for blow, m in blows.items() if contact is not None}
    dampings = {blow: model.calibration.damping_factor(fit, v, u or 0.0) for blow, (v, u) in speeds.items()}
    lines = [f"{path}: {contact or 'felt'}, {1e3 * fit.measured_m[0]:.3g} to {1e3 * fit.measured_m[1]:.3g} mm"]
    for name, unit, v, u in zip("abc", ("N/m^3", "N/m^2", "N/m"), fit.abc, fit.u_abc, strict=True):
        lines.append(f"  {name} = {v:.4g} {unit} (standard uncertainty {u:.2g} {unit})")
    lines.append(f"  mid-line off the cubic: {fit.misfit_n:.3g} N rms of {fit.mid_n[-1]:.3g} N")
    lines += [f"  {line}" for line in _describe_misfit(fit)]
    if fit.off:
        lines.append(f"  uncertainty includes what all points share: {', '.join(fit.off)}")
    if fit.bound is not None:
        lines.append(f"  the fit lies on a bound of what a felt can do: {fit.bound}; look at the figure")
    for blow, one in dampings.items():
        lines.append(
            f"  D = {one.d:.4g} s/m (standard uncertainty {one.u_d:.2g} s/m; {blow}: {one.speed_m_per_s:.4g} m/s; "
            f"taken at {1e3 * one.at_m:.3g} mm)"
        )
    if figure is not None:
        model.calibration.figure.draw(curve, fit, dampings, contact or path.stem, figure)
        lines.append(f"  {figure}")
    facts = {
        "file": path,
        "contact": contact,
        "abc": fit.abc,
        "u_abc": fit.u_abc,
        "covariance": fit.covariance,
        "measured_m": fit.measured_m,
        "misfit_n": fit.misfit_n,
        "u_mid_n": fit.u_mid_n,
        "law_fits": fit.law_fits,
        "loop_misfit_n": fit.loop_misfit_n,
        "loop_fits": fit.loop_fits,
        "u_widened": fit.inflation_factor,
        "bound": fit.bound,
        "common_errors": {name: other.free_abc - fit.free_abc for name, other in fit.off.items()},
        "D": {b: {"d": o.d, "u": o.u_d, "at_m": o.at_m, "speed_m_per_s": o.speed_m_per_s} for b, o in dampings.items()},
        "figure": figure,
    }
    if contact is None:
        return Calibrated(facts, lines, {})
    values = {f"{contact}.normal.{k}": (float(v), float(u)) for k, v, u in zip("abc", fit.abc, fit.u_abc, strict=True)}
    for first in list(dampings.values())[:1]:
        values[f"{contact}.normal.D"] = (first.d, first.u_d)
    return Calibrated(facts, lines, values)


def _describe_misfit(fit: model.calibration.FeltFit) -> list[str]:
    """Lines that say where the measured points contradict the cubic (eq. 2.5) or the damping (eq. 2.7) by more than
    their scatter; none where both fit."""
    lines = []
    if not fit.law_fits:
        lines.append(
            f"the law does not fit: the points know their mid-line to {fit.u_mid_n:.2g} N rms, the cubic of eq. 2.5 is "
            f"{fit.inflation_factor:.2g} x as far off; the uncertainty of a, b, c is widened by that factor"
        )
    if not fit.loop_fits:
        lines.append(
            f"the loop does not fit: loading above unloading is not one share of the cubic at every depth (eq. 2.7), "
            f"off by {fit.loop_misfit_n:.2g} N rms; the uncertainty of D is widened; the felt is hereditary, "
            "or the speed changed"
        )
    return lines


def _calibrate_friction(contact: str | None, mu: Sequence[float], u: Sequence[float]) -> Calibrated:
    """Parameters A, B1, B2 of a contact's friction (eq. 2.10) as facts, a line and values with u, from ``mu`` (static,
    kinetic coefficient) and ``u`` (their standard uncertainties)."""
    fit = model.calibration.fit_friction(*mu, *u)
    facts = {"A": fit.a, "B1": fit.b1, "B2": fit.b2, "u_A": fit.u_a, "u_B1": fit.u_b1}
    line = (
        f"friction {contact or ''} (eq. 2.10; standard uncertainties): A = {fit.a:.4g} ({fit.u_a:.2g}), "
        f"B1 = {fit.b1:.4g} ({fit.u_b1:.2g}), B2 = {fit.b2:g}"
    )
    values = {"A": (fit.a, fit.u_a), "B1": (fit.b1, fit.u_b1), "B2": (fit.b2, 0.0)}
    return Calibrated(facts, [line], {f"{contact}.friction.{k}": v for k, v in values.items()} if contact else {})


def _calibrate_rebound(speeds: Sequence[float], u: Sequence[float]) -> Calibrated:
    """The string's damping from the hammer head's speed before and after it."""
    d, u_d = model.calibration.damping_from_rebound(*speeds, *u)
    line = f"string {STRING}: D = {d:.4g} s/m (standard uncertainty {u_d:.2g} s/m)"
    return Calibrated({"D": d, "u_D": u_d}, [line], {f"{STRING}.normal.D": (d, u_d)})


def _calibrate_pendulum(
    action: model.Action, body: str | None, swing: Sequence[float], u: Sequence[float]
) -> Calibrated:
    """A body's inertia, kg m², by its ``swing`` (mass, kg; arm, m; period, s) as a pendulum (eqs A.1, A.2) and their
    standard uncertainties ``u``: facts, a line, and, where ``body`` is named, the value about its centre of mass."""
    if body is not None and body not in model.BODIES:
        raise CommandInputError(f"--body {body}: not found; allowed {', '.join(model.BODIES)}")
    u_of = dict(zip(("u_mass_kg", "u_arm_m", "u_period_s"), u, strict=True))
    found = model.calibration.inertia_from_pendulum(*swing, **u_of, g=action["gravity.g"])
    facts = {
        "about_pivot_kg_m2": found.about_pivot,
        "about_center_kg_m2": found.about_center,
        "u_about_pivot_kg_m2": found.u_about_pivot,
        "u_about_center_kg_m2": found.u_about_center,
    }
    line = (
        f"inertia {body or ''}, kg m^2 (standard uncertainty): {found.about_pivot:.4g} ({found.u_about_pivot:.2g}) "
        f"about the pivot, {found.about_center:.4g} ({found.u_about_center:.2g}) about the centre of mass"
    )
    values = {f"{body}.inertia": (found.about_center, found.u_about_center)} if body else {}
    return Calibrated(facts, [line], values)


def _fit_felt_laws(paths: Sequence[Path], contact: str | None, figure: Path | None) -> Calibrated:
    """Fit every felt law to all presses (CSV files) and judge it by presses held out: facts and lines of all; parameter
    values, where a contact is named, are those of the thesis's law, also if another is nearer."""
    if len(paths) < FEWEST_PRESSES:
        raise CommandInputError(
            f"calibrate felt: found {len(paths)} presses, allowed {FEWEST_PRESSES} or more, to judge laws by presses "
            "held out; or one curve"
        )
    presses = [model.felt.read_pressing(path) for path in paths]
    fits = [model.felt.fit_law(kind, presses) for kind in model.felt.LAWS]
    speeds, peaks = [1e3 * p.speed_m_per_s for p in presses], [p.peak_n for p in presses]
    noise = {press.name: press.noise_n / press.peak_n for press in presses}
    lines = [
        f"{contact or 'felt'}: {len(presses)} presses, {min(speeds):.3g} to {max(speeds):.3g} mm/s, peaks of "
        f"{min(peaks):.3g} to {max(peaks):.3g} N",
        f"  {'law':<14} {'held out':>9} {'fitted':>9}   error, share of the peak force, typical press",
    ]
    for fit in fits:
        lines.append(f"  {fit.kind:<14} {fit.typical_held_out:>9.2%} {float(fit.misfit.mean()):>9.2%}")
    lines.append(f"  {'noise':<14} {sum(noise.values()) / len(noise):>9.2%}")
    for fit in fits:
        lines.append(
            f"  {fit.kind} (standard uncertainty): " + ", ".join(_value(fit, k) for k in range(len(fit.names)))
        )
    if figure is not None:
        model.felt.figure.draw(presses, fits, contact or "felt", figure)
        lines.append(f"  {figure}")
    values: dict[str, tuple[float, float]] = {}
    if contact is not None:
        thesis = next(fit for fit in fits if fit.kind == THESIS_LAW)
        values = {
            f"{contact}.normal.{name}": (value, u)
            for name, value, u in zip(thesis.names, thesis.values, thesis.u, strict=True)
        }
        best = min(fits, key=lambda fit: fit.typical_held_out)
        if best is not thesis:
            lines.append(f"  {contact} gets the values of {THESIS_LAW}, the law of the model; {best.kind} is nearer")
    laws = {
        fit.kind: {
            "values": dict(zip(fit.names, fit.values, strict=True)),
            "u": dict(zip(fit.names, fit.u, strict=True)),
            "units": dict(zip(fit.names, fit.units, strict=True)),
            "held_out_error": dict(zip(noise, fit.held_out.tolist(), strict=True)),
            "misfit_fitted": dict(zip(noise, fit.misfit.tolist(), strict=True)),
        }
        for fit in fits
    }
    return Calibrated({"contact": contact, "laws": laws, "noise": noise, "figure": figure}, lines, values)


def _value(fit: model.felt.LawFit, k: int) -> str:
    unit = "" if fit.units[k] == "1" else f" {fit.units[k]}"
    return f"{fit.names[k]} = {fit.values[k]:.4g} ({fit.u[k]:.2g}){unit}"
