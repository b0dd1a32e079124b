"""Moment of inertia of a body from its period as a pendulum, eqs. A.1 and A.2 of the thesis.

Small swings: at 10 degrees of amplitude the period is 0.2 % longer and the inertia about the pivot 0.4 % too large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from model.calibration.checks import check_numbers
from model.errors import InputError


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
    """Inertia about the pivot (eq. A.1) and about the centre of mass (eq. A.2).

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
