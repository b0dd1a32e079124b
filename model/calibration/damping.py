"""Damping factor D of a contact, eq. 2.7: with it the model follows the loading curve at the speeds of a blow.

D in s/m; the speed is the mean normal speed of the contact in the trial it is calibrated for. A felt whose loading
curve is nowhere above the fit is refused: it has no loss to calibrate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from model.calibration.checks import check_numbers
from model.calibration.felt import FeltFit
from model.errors import InputError


@dataclass(frozen=True)
class Damping:
    """D with its standard uncertainty, s/m, and the depth ``at_m`` where loading and fit differ most."""

    d: float
    u_d: float
    at_m: float
    speed_m_per_s: float


def damping_factor(fit: FeltFit, speed_m_per_s: float, u_speed_m_per_s: float = 0.0) -> Damping:
    """D = (f_loading(x_max) / f_fit(x_max) - 1) / mean speed, eq. 2.7.

    Parameters
    ----------
    fit : cubic and smoothed loading curve
    speed_m_per_s, u_speed_m_per_s : mean normal speed of the contact and its standard uncertainty

    Returns
    -------
    Damping
        D and its standard uncertainty, s/m.

    Raises
    ------
    InputError : the speed is not positive, or loading is nowhere above the fit

    Examples
    --------
    >>> import model
    >>> fit = model.calibration.fit_felt(model.calibration.read_curve("felt.csv"))
    >>> model.calibration.damping_factor(fit, speed_m_per_s=0.05).d > 0.0
    True
    """
    check_numbers("damping", {"mean normal speed": speed_m_per_s}, {"mean normal speed": u_speed_m_per_s}, "m/s")
    x, above = fit.mid_m, fit.loading.force_n(fit.mid_m) - fit.force_n(fit.mid_m)
    k = int(np.argmax(above))
    if above[k] <= 0.0 or x[k] <= 0.0:
        raise InputError(
            f"damping: loading minus fit found {above[k]:g} N at most, allowed above 0; are the phases swapped?"
        )
    ratio, u_ratio = fit.loading_ratio(float(x[k]))
    d = (ratio - 1.0) / speed_m_per_s
    return Damping(
        d=d,
        u_d=math.hypot(u_ratio / speed_m_per_s, d * u_speed_m_per_s / speed_m_per_s),
        at_m=float(x[k]),
        speed_m_per_s=speed_m_per_s,
    )
