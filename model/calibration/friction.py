"""Friction parameters A, B1, B2 of eq. 2.10 from the static and kinetic coefficients of friction.

The threshold speed v_t only stretches the curve and does not enter. B2 = 1 as in Table A.8; A is the kinetic
coefficient, and B1 raises the peak of the curve to the static one (thesis Section 2.2.4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from model.calibration.checks import check_numbers
from model.errors import InputError

B2 = 1.0
LARGEST_B1 = 100.0  # the parameter file's bound


@dataclass(frozen=True)
class FrictionFit:
    """Parameters of eq. 2.10 with standard uncertainties; ``b2`` is chosen, not measured."""

    a: float
    b1: float
    u_a: float
    u_b1: float
    b2: float = B2


def peak_ratio(b1: float, b2: float = B2) -> float:
    """Largest value over s >= 0 of tanh(s) + b1 s / (1 + b2 s**4): static over kinetic coefficient, eq. 2.10."""
    if b1 == 0.0:
        return 1.0  # only approached, at infinite speed
    s = np.geomspace(1e-3, 1e3, 2001)
    values = np.tanh(s) + b1 * s / (1.0 + b2 * s**4)
    k = int(np.clip(np.argmax(values), 1, len(s) - 2))
    best = minimize_scalar(
        lambda r: -(math.tanh(r) + b1 * r / (1.0 + b2 * r**4)),
        bounds=(s[k - 1], s[k + 1]),
        method="bounded",
        options={"xatol": 1e-10},
    )
    return max(1.0, -float(best.fun))


def _b1(ratio: float) -> float:
    if ratio == 1.0:
        return 0.0
    return float(brentq(lambda b: peak_ratio(b) - ratio, 0.0, LARGEST_B1, xtol=1e-12))


def fit_friction(mu_s: float, mu_k: float, u_mu_s: float = 0.0, u_mu_k: float = 0.0) -> FrictionFit:
    """Fit eq. 2.10 to a static and a kinetic coefficient of friction.

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
    b1 = _b1(ratio)
    # dB1/dratio by a central difference, one-sided at the ends of the allowed range
    step = 1e-4
    low, high = max(1.0, ratio - step), min(largest, ratio + step)
    slope = (_b1(high) - _b1(low)) / (high - low)
    u_ratio = ratio * math.hypot(u_mu_s / mu_s, u_mu_k / mu_k)
    return FrictionFit(a=mu_k, b1=b1, u_a=u_mu_k, u_b1=slope * u_ratio)
