"""Codes of the analog-to-digital converter behind a force channel, from its electrical readings.

They are stored where the readings give whole codes again by the polynomial with which the driver says that it scales
them: then they are the converter's, to the last bit, and a stuck bit, a missing code or the end of the range shows in
them. Where they do not, the driver has done more than it states (a nulled bridge, a filter): no code.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rig.session.info import ForceInfo

NO_CODE = -(2**31)  # in place of a code that is not whole
WHOLE = 0.02  # largest distance from a whole number, codes
_STEPS = 6  # of Newton's method: digits double with each


def force_codes(reading: NDArray[np.float64], info: ForceInfo) -> NDArray[np.int64]:
    """Code of the analog-to-digital converter of each electrical reading (n,), in the channel's electrical unit, by
    inverting the driver's polynomial in ``info.device_scaling``; ``NO_CODE`` where that gives no whole number, or no
    scaling is stated."""
    volts = np.asarray(reading, dtype=np.float64) * info.volts_per_unit
    gain = info.device_scaling[1] if len(info.device_scaling) > 1 else 0.0
    if gain == 0.0:
        return np.full(volts.shape, NO_CODE, dtype=np.int64)
    scaling = np.polynomial.Polynomial(info.device_scaling)
    slope = scaling.deriv()
    with np.errstate(all="ignore"):
        code = (volts - info.device_scaling[0]) / gain
        for _ in range(_STEPS if len(info.device_scaling) > 2 else 0):
            code = code - (scaling(code) - volts) / slope(code)
        whole = np.rint(code)
        known = np.isfinite(code) & (np.abs(code - whole) <= WHOLE) & (np.abs(whole) < 2**31)
    return np.where(known, np.where(known, whole, 0.0), NO_CODE).astype(np.int64)
