"""Friction, string damping and inertia from measured numbers, and an action that takes calibrated values on.

Friction, eq. 2.10: B2 = 1 as in Table A.8; A is the kinetic coefficient, and B1 raises the peak of the curve to the
static one (thesis Section 2.2.4); the threshold speed v_t only stretches the curve and does not enter.

Damping of the string's contact from the hammer's speeds before and after it; the thesis adjusted it by trial until the
rebound was right (Section 2.2.3). For a body of mass m that meets only f = f_fit(x) (1 + D v) (eq. 2.4),
m v dv = -f dx gives v dv / (1 + D v) = -f_fit(x) dx / m. Compression and rebound integrate the same f_fit, so
G(v_in) = G(-v_out) with G(v) = D v - ln(1 + D v), whatever the felt and the mass. Neglected: gravity and joint friction
during the millisecond of contact.

Inertia of a body from its period as a pendulum, eqs. A.1 and A.2, for small swings: at 10 degrees of amplitude the
period is 0.2 % longer and the inertia about the pivot 0.4 % too large.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from model.errors import InputError
from model.parameters.action import Action, ActionLike, as_action

B2 = 1.0
RESOLVED = 1e-10  # of a variable of order one, in a search: below what rounding leaves of a minimum
LARGEST_B1 = 100.0  # the parameter file's bound
SMALLEST_LOSS = 1e-9  # of the speed: below this damping cannot be distinguished from rounding


def check_numbers(what: str, values: Mapping[str, float], uncertainties: Mapping[str, float], unit: str = "") -> None:
    """Raise `InputError`, which begins with ``what``, for values by name that are not above 0 and standard
    uncertainties below 0."""
    unit = f" {unit}" if unit else ""
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{what}: {name} found {value:g}{unit}, allowed above 0")
    for name, value in uncertainties.items():
        if not (math.isfinite(value) and value >= 0.0):
            raise InputError(f"{what}: u of {name} found {value:g}{unit}, allowed from 0")


@dataclass(frozen=True)
class FrictionFit:
    """Parameters of eq. 2.10 with standard uncertainties; ``b2`` is chosen, not measured."""

    a: float
    b1: float
    u_a: float
    u_b1: float
    b2: float = B2


def peak_ratio(b1: float) -> float:
    """Largest value over scaled speeds s >= 0 of tanh(s) + b1 s / (1 + B2 s**4), the static over the kinetic
    coefficient of friction (thesis eq. 2.10); at least 1."""
    if b1 == 0.0:
        return 1.0  # only approached, at infinite speed
    s = np.geomspace(1e-3, 1e3, 2001)  # shares of the speed scale: the largest lies within, a step is 0.7 %
    values = np.tanh(s) + b1 * s / (1.0 + B2 * s**4)
    k = int(np.clip(np.argmax(values), 1, len(s) - 2))
    best = minimize_scalar(
        lambda r: -(math.tanh(r) + b1 * r / (1.0 + B2 * r**4)),
        bounds=(s[k - 1], s[k + 1]),
        method="bounded",
        options={"xatol": RESOLVED},
    )
    return max(1.0, -float(best.fun))


def _solve_b1(ratio: float) -> float:
    if ratio == 1.0:
        return 0.0
    return float(brentq(lambda b: peak_ratio(b) - ratio, 0.0, LARGEST_B1, xtol=1e-12))


def fit_friction(mu_s: float, mu_k: float, u_mu_s: float = 0.0, u_mu_k: float = 0.0) -> FrictionFit:
    """A, the kinetic coefficient, and B1 of the friction law A (tanh(s) + B1 s / (1 + B2 s^4)) over scaled speed s
    (thesis eq. 2.10), whose peak is ``mu_s``, with standard uncertainties; B2 is given.

    Parameters
    ----------
    mu_s, mu_k : static and kinetic coefficient
    u_mu_s, u_mu_k : their standard uncertainties, taken as independent

    Returns
    -------
    FrictionFit
        A and B1 with their standard uncertainties; B2 is chosen.

    Raises
    ------
    InputError : a coefficient is not positive, mu_s is below mu_k, or so far above that B1 would pass its bound

    Examples
    --------
    >>> import model
    >>> fit = model.calibration.fit_friction(0.30, 0.25, u_mu_s=0.01, u_mu_k=0.01)
    >>> fit.a, fit.u_a
    (0.25, 0.01)
    """
    check_numbers("friction", {"mu_s": mu_s, "mu_k": mu_k}, {"mu_s": u_mu_s, "mu_k": u_mu_k})
    ratio, largest = mu_s / mu_k, peak_ratio(LARGEST_B1)
    if not 1.0 <= ratio <= largest:
        raise InputError(
            f"friction: mu_s / mu_k found {ratio:g}, allowed 1 to {largest:.3g}; is the static coefficient given first?"
        )
    b1 = _solve_b1(ratio)
    # dB1/dratio by a central difference, one-sided at the ends of the allowed range
    step = 1e-4  # of a ratio of order one: the root search is good to 1e-10
    low, high = max(1.0, ratio - step), min(largest, ratio + step)
    slope = (_solve_b1(high) - _solve_b1(low)) / (high - low)
    u_ratio = ratio * math.hypot(u_mu_s / mu_s, u_mu_k / mu_k)
    return FrictionFit(a=mu_k, b1=b1, u_a=u_mu_k, u_b1=slope * u_ratio)


def _compression(y: float) -> float:
    """G(v) at y = D v; a series where y - ln(1 + y) would cancel."""
    if y < 1e-3:
        return sum((-y) ** k / k for k in range(2, 7))
    return y - math.log1p(y)


def _rebound(w: float) -> float:
    """G(-v) at w = -ln(1 - D v): D v itself comes too near to 1 for double precision."""
    if w < 1e-3:
        return sum((-w) ** k / math.factorial(k) for k in range(2, 7))
    return w + math.expm1(-w)


def damping_from_rebound(v_in: float, v_out: float, u_v_in: float = 0.0, u_v_out: float = 0.0) -> tuple[float, float]:
    """Damping factor (s/m) of the string, and its standard uncertainty, from the hammer's speeds (m/s, both above 0)
    before and after it.

    Parameters
    ----------
    v_in, v_out : speeds of the contact point before and after, m/s, both positive
    u_v_in, u_v_out : standard uncertainties, taken as independent

    Returns
    -------
    tuple of float
        D and its standard uncertainty, s/m.

    Raises
    ------
    InputError : a speed is not positive, or the body leaves faster than it arrived

    Examples
    --------
    >>> import model
    >>> d, u = model.calibration.damping_from_rebound(2.0, 1.1, u_v_in=0.02, u_v_out=0.02)
    >>> print(f"{d:.2f} s/m, u {u:.2f}")
    0.59 s/m, u 0.02
    """
    speeds, u_speeds = {"speed before": v_in, "speed after": v_out}, {"speed before": u_v_in, "speed after": u_v_out}
    check_numbers("rebound", speeds, u_speeds, "m/s")
    if v_out > v_in * (1.0 - SMALLEST_LOSS):
        raise InputError(f"rebound: speed after found {v_out:g} m/s, allowed below the speed before, {v_in:g} m/s")

    def solve(before: float, after: float) -> float:
        def missing(w: float) -> float:
            d = -math.expm1(-w) / after
            return (_compression(d * before) - _rebound(w)) / w**2

        w = brentq(missing, 1e-9, before / after + 2.0, xtol=1e-300, rtol=1e-14)
        return float(-math.expm1(-w) / after)

    d = solve(v_in, v_out)
    step = 1e-5 * (v_in - v_out)  # cube root of rounding: best for a central difference
    by_in = (solve(v_in + step, v_out) - solve(v_in - step, v_out)) / (2.0 * step)
    by_out = (solve(v_in, v_out + step) - solve(v_in, v_out - step)) / (2.0 * step)
    return d, math.hypot(by_in * u_v_in, by_out * u_v_out)


@dataclass(frozen=True)
class Inertia:
    """Moments of inertia, kg m^2, with standard uncertainties."""

    about_pivot: float
    about_center: float
    u_about_pivot: float
    u_about_center: float


def inertia_from_pendulum(
    mass_kg: float,
    arm_m: float,
    period_s: float,
    *,
    u_mass_kg: float = 0.0,
    u_arm_m: float = 0.0,
    u_period_s: float = 0.0,
    g: float = 9.81,
) -> Inertia:
    """Moments of inertia, kg m^2, about pivot and centre of mass, with standard uncertainties, of a body that swings
    with the full period ``period_s``, its centre of mass ``arm_m`` from the pivot.

    Parameters
    ----------
    mass_kg : mass of the body
    arm_m : distance from the pivot to the centre of mass
    period_s : time of one full swing
    u_mass_kg, u_arm_m, u_period_s : standard uncertainties, taken as independent
    g : gravity, m/s^2

    Returns
    -------
    Inertia
        Moments, kg m^2, with their standard uncertainties.

    Raises
    ------
    InputError : a value is not positive, or the period is shorter than that of a point mass at the same arm

    Examples
    --------
    >>> import model
    >>> print(f"{model.calibration.inertia_from_pendulum(0.0117, 0.10, 0.65).about_pivot:.3e} kg m^2")
    1.228e-04 kg m^2
    """
    check_numbers(
        "pendulum",
        {"mass": mass_kg, "arm": arm_m, "period": period_s, "g": g},
        {"mass": u_mass_kg, "arm": u_arm_m, "period": u_period_s},
    )
    turn = (period_s / (2.0 * math.pi)) ** 2
    pivot = mass_kg * g * arm_m * turn
    center = pivot - mass_kg * arm_m**2
    if center <= 0.0:
        shortest = 2.0 * math.pi * math.sqrt(arm_m / g)
        raise InputError(
            f"pendulum: period found {period_s:g} s, allowed above {shortest:.4g} s for an arm of {arm_m:g} m; "
            "check the arm, or time full swings, to and fro"
        )
    from_mass = u_mass_kg / mass_kg
    from_period = 2.0 * u_period_s / period_s * pivot
    return Inertia(
        about_pivot=pivot,
        about_center=center,
        u_about_pivot=math.hypot(from_mass * pivot, u_arm_m / arm_m * pivot, from_period),
        u_about_center=math.hypot(
            from_mass * center, u_arm_m * (mass_kg * g * turn - 2.0 * mass_kg * arm_m), from_period
        ),
    )


def with_calibrated(action: ActionLike, values: Mapping[str, tuple[float, float]], source: str) -> Action:
    """Copy of ``action`` with measured values, path -> (value, standard uncertainty) in the quantity's unit, each noted
    as measured, with ``source``; `InputError` for an unknown path or a value out of range.

    Parameters
    ----------
    action : given set
    values : path -> value and standard uncertainty, in the unit of the path
    source : of the values, for the file

    Returns
    -------
    Action

    Raises
    ------
    InputError : a path does not exist or a value lies outside its range

    Examples
    --------
    >>> import model
    >>> measured = {"hammer.mass": (0.0117, 0.0001)}
    >>> mine = model.calibration.with_calibrated(model.load_action(), measured, "weighed, 2026-11-22")
    >>> mine.quantities["hammer.mass"].u
    0.0001
    """
    action = as_action(action)
    changed = action.with_values({path: value for path, (value, _) in values.items()}, "calibration")
    quantities = dict(changed.quantities)
    for path, (_, u) in values.items():
        quantities[path] = replace(quantities[path], u=u, basis="measured", source=source)
    return replace(changed, quantities=quantities, changed=dict(action.changed))
