"""Damping factor of the string's contact from the hammer's speeds before and after it.

The thesis adjusted it by trial until the rebound was right (Section 2.2.3). For a body of mass m that meets only
f = f_fit(x) (1 + D v) (eq. 2.4), m v dv = -f dx gives v dv / (1 + D v) = -f_fit(x) dx / m. Compression and rebound
integrate the same f_fit, so G(v_in) = G(-v_out) with G(v) = D v - ln(1 + D v), whatever the felt and the mass.
Neglected: gravity and joint friction during the millisecond of contact.
"""

from __future__ import annotations

import math

from scipy.optimize import brentq

from model.calibration.checks import check_numbers
from model.errors import InputError

SMALLEST_LOSS = 1e-9  # of the speed: below this damping cannot be distinguished from rounding


def _compression(y: float) -> float:
    """G(v) at y = D v; a series where y - ln(1 + y) would cancel."""
    if y < 1e-3:
        return y * y * (0.5 - y * (1.0 / 3.0 - y * (0.25 - y * (0.2 - y / 6.0))))
    return y - math.log1p(y)


def _rebound(w: float) -> float:
    """G(-v) at w = -ln(1 - D v): D v itself comes too near to 1 for double precision."""
    if w < 1e-3:
        return w * w * (0.5 - w * (1.0 / 6.0 - w * (1.0 / 24.0 - w * (1.0 / 120.0 - w / 720.0))))
    return w + math.expm1(-w)


def rebound_speed(damping: float, v_in: float) -> float:
    """Speed after the contact, m/s, of a body that meets felt of factor ``damping`` (s/m) at ``v_in`` (m/s)."""
    if damping == 0.0:
        return v_in
    lost = _compression(damping * v_in)
    top = lost + math.sqrt(2.0 * lost) + 1.0
    w = brentq(lambda w: _rebound(w) - lost, 0.0, top, xtol=1e-300, rtol=1e-14)
    return float(-math.expm1(-w) / damping)


def damping_from_rebound(v_in: float, v_out: float, u_v_in: float = 0.0, u_v_out: float = 0.0) -> tuple[float, float]:
    """Damping factor of the string from the hammer's speeds before and after it.

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
    step = 1e-5 * (v_in - v_out)
    by_in = (solve(v_in + step, v_out) - solve(v_in - step, v_out)) / (2.0 * step)
    by_out = (solve(v_in, v_out + step) - solve(v_in, v_out - step)) / (2.0 * step)
    return d, math.hypot(by_in * u_v_in, by_out * u_v_out)
