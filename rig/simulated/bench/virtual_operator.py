"""The virtual operator in a self-test: lifts the arm off the key, puts it back, presses the key down and lets go.

With ``sim://?hand=yes`` (or ``serve-sim --hand``) this happens in every acquisition whose motor command is 0 V
throughout, which is when ``pianorig selftest`` asks the operator to do just this. Pressing is a torque on the arm, so
that all bodies move as the mechanism makes them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LIFTED_S = (0.4, 1.2)
PRESS_S = (1.8, 2.6, 3.0, 3.5)
"""Begin, key at the bottom, let go, key up again."""
PRESS_N = 2.5


def press_n(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the force of the operator at the arm's tip, N."""
    return np.interp(time_s, PRESS_S, (0.0, PRESS_N, PRESS_N, 0.0))


def lifted(time_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return when the arm is off the key."""
    return (time_s >= LIFTED_S[0]) & (time_s < LIFTED_S[1])
