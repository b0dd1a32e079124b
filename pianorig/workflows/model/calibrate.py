"""``pianorig calibrate-felt``: what each measurement on a part says of the action's parameters.

Each function answers one measurement: JSON facts, lines to print, and values with standard uncertainty by path.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

import model
from model.arrays import as_numbers
from model.calibration import (
    REST_SHARE,
    FeltFit,
    MeanSpeeds,
    damping_factor,
    damping_from_rebound,
    fit_felt,
    fit_friction,
    inertia_from_pendulum,
    mean_normal_speeds,
    read_curve,
    read_motion,
)
from model.calibration.figure import draw
from pianorig.console.output import nan_as_null
from pianorig.console.overrides import read_measured
from pianorig.errors import CommandInputError
from pianorig.workflows.model.force_input import read_driving_force

STRING = "contact12"
THESIS_RATIO = "four to five times"


class Calibrated(NamedTuple):
    """What a measurement gives."""

    facts: dict[str, Any]
    """For JSON."""
    lines: list[str]
    """To print."""
    values: dict[str, tuple[float, float]]
    """Path to value and standard uncertainty, for the action's file; empty where the part is not named."""


def blow_speeds(
    action: model.Action, forces: Sequence[Path], motions: Sequence[Path]
) -> tuple[dict[str, MeanSpeeds], Calibrated]:
    """Mean normal speed of each contact in blows, simulated from forces or read, by name of the file."""
    blows: dict[str, MeanSpeeds] = {}
    for path in [*forces, *motions]:
        if path.stem in blows:
            raise CommandInputError(f"{path}: a blow named {path.stem} is there already; rename the file")
        moved: tuple[Any, ...]
        if path in forces:
            driving = read_driving_force(path)
            seen = model.simulate(action, driving.time_s, driving.force_n)
            moved = (seen.time_s, seen.angle_rad, seen.speed_rad_per_s)
        else:
            moved = read_motion(path)
        blows[path.stem] = mean_normal_speeds(action, *moved)
    if not blows:
        return blows, Calibrated({}, [], {})
    facts = {
        blow: {
            name: nan_as_null({"mean_normal_speed_m_per_s": v, "counted_s": t})
            for name, v, t in zip(m.contacts, m.speed_m_per_s.tolist(), m.counted_s.tolist(), strict=True)
        }
        for blow, m in blows.items()
    }
    return blows, Calibrated({"blows": facts}, _speed_table(blows), {})


def _speed_table(blows: dict[str, MeanSpeeds]) -> list[str]:
    """Mean speeds, and with two blows what that means for D."""
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


def felt(
    action: model.Action,
    path: Path,
    contact: str | None,
    speed: str | None,
    blows: dict[str, MeanSpeeds],
    figure: Path | None,
) -> Calibrated:
    """The felt's cubic from a loading experiment, its damping from the mean speeds, drawn if a figure is named."""
    if contact is not None and f"{contact}.normal.a" not in action.quantities:
        raise CommandInputError(f"--contact {contact}: not found; allowed contact01 to contact13")
    if blows and contact is None:
        raise CommandInputError("--contact: missing; it says whose mean speed in the blow counts")
    curve = read_curve(path)
    fit = fit_felt(curve)
    speeds = {} if speed is None else {"--speed": read_measured(speed, "--speed")}
    speeds |= {blow: (m.of(contact), None) for blow, m in blows.items() if contact is not None}
    dampings = {blow: damping_factor(fit, v, u or 0.0) for blow, (v, u) in speeds.items()}
    lines = [f"{path}: {contact or 'felt'}, {1e3 * fit.measured_m[0]:.3g} to {1e3 * fit.measured_m[1]:.3g} mm"]
    for name, unit, v, u in zip("abc", ("N/m^3", "N/m^2", "N/m"), fit.abc, fit.u_abc, strict=True):
        lines.append(f"  {name} = {v:.4g}  u {u:.2g}  {unit}")
    lines.append(f"  mid-line off the cubic: {fit.misfit_n:.3g} N rms of {fit.mid_n[-1]:.3g} N")
    lines += [f"  {line}" for line in _judgement(fit)]
    if fit.off:
        lines.append(f"  u includes what all points share: {', '.join(fit.off)}")
    if fit.bound is not None:
        lines.append(f"  the fit lies on a bound of what a felt can do: {fit.bound}; look at the figure")
    for blow, one in dampings.items():
        lines.append(
            f"  D = {one.d:.4g}  u {one.u_d:.2g}  s/m  ({blow}: {one.speed_m_per_s:.4g} m/s; taken at "
            f"{1e3 * one.at_m:.3g} mm)"
        )
    if figure is not None:
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
        "u_mid_n": fit.u_mid_n,
        "law_fits": fit.law_fits,
        "loop_misfit_n": fit.loop_misfit_n,
        "loop_fits": fit.loop_fits,
        "u_widened": fit.widened,
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


def _judgement(fit: FeltFit) -> list[str]:
    """What the measured points say against the law of eqs 2.5 and 2.7."""
    lines = []
    if not fit.law_fits:
        lines.append(
            f"the law does not fit: the points know their mid-line to {fit.u_mid_n:.2g} N rms, the cubic of eq. 2.5 is "
            f"{fit.widened:.2g} x as far off; u of a, b, c widened by that factor"
        )
    if not fit.loop_fits:
        lines.append(
            f"the loop does not fit: loading above unloading is not one share of the cubic at every depth (eq. 2.7), "
            f"off by {fit.loop_misfit_n:.2g} N rms; u of D widened; a felt that remembers, or a speed that changed"
        )
    return lines


def _row(values: ArrayLike, where: str) -> list[float]:
    row: list[float] = as_numbers(values, where, 1).tolist()
    return row


def friction(contact: str | None, mu: ArrayLike, u: ArrayLike) -> Calibrated:
    """Eq. 2.10 from static and kinetic coefficient."""
    fit = fit_friction(*_row(mu, "friction"), *_row(u, "u of friction"))
    facts = {"A": fit.a, "B1": fit.b1, "B2": fit.b2, "u_A": fit.u_a, "u_B1": fit.u_b1}
    line = (
        f"friction {contact or ''}: A = {fit.a:.4g}  u {fit.u_a:.2g}, B1 = {fit.b1:.4g}  u {fit.u_b1:.2g}, "
        f"B2 = {fit.b2:g} (eq. 2.10)"
    )
    values = {"A": (fit.a, fit.u_a), "B1": (fit.b1, fit.u_b1), "B2": (fit.b2, 0.0)}
    return Calibrated(facts, [line], {f"{contact}.friction.{k}": v for k, v in values.items()} if contact else {})


def rebound(speeds: ArrayLike, u: ArrayLike) -> Calibrated:
    """The string's damping from the hammer head's speed before and after it."""
    d, u_d = damping_from_rebound(*_row(speeds, "rebound"), *_row(u, "u of rebound"))
    line = f"string {STRING}: D = {d:.4g}  u {u_d:.2g}  s/m"
    return Calibrated({"D": d, "u_D": u_d}, [line], {f"{STRING}.normal.D": (d, u_d)})


def pendulum(action: model.Action, body: str | None, swing: ArrayLike, u: ArrayLike) -> Calibrated:
    """A body's inertia from its mass, arm and period as a pendulum (eqs A.1, A.2)."""
    if body is not None and body not in model.BODIES:
        raise CommandInputError(f"--body {body}: not found; allowed {', '.join(model.BODIES)}")
    mass, arm, period = _row(u, "u of pendulum")
    found = inertia_from_pendulum(
        *_row(swing, "pendulum"), u_mass_kg=mass, u_arm_m=arm, u_period_s=period, g=action["gravity.g"]
    )
    facts = {
        "about_pivot_kg_m2": found.about_pivot,
        "about_center_kg_m2": found.about_center,
        "u_about_pivot_kg_m2": found.u_about_pivot,
        "u_about_center_kg_m2": found.u_about_center,
    }
    line = (
        f"inertia {body or ''}: {found.about_pivot:.4g}  u {found.u_about_pivot:.2g}  kg m^2 about the pivot, "
        f"{found.about_center:.4g}  u {found.u_about_center:.2g}  about the centre of mass"
    )
    values = {f"{body}.inertia": (found.about_center, found.u_about_center)} if body else {}
    return Calibrated(facts, [line], values)
