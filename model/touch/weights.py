"""Touch weights of a slow press and release of the key: force over dip, down, up and friction weight, let-off peak.

An action in; forces in N at the key front, dips in m. The key goes down to first touch of its felt and comes back at a
steady speed, with all friction. Weights are medians over the middle of the dip, where a technician's weights move the
key.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.errors import InputError
from model.motion_driven.slow_press import Press, slow_press
from model.parameters.action import Action
from model.regulation.measures import at_rest
from model.simulation.hand_set_rest import hand_set_rest

Array = NDArray[np.float64]

PRESS_SPEED = 0.005  # m/s
HOLD = 0.3  # s at the bottom
MIDDLE = (0.25, 0.60)  # of the dip: the jack carries the hammer and does not touch the button yet
SMOOTH = 0.02  # s, moving average before a peak is read


@dataclass(frozen=True)
class Weights:
    """Forces in N at the key front, the depth of the dip, and the press that they were read from."""

    down_n: float
    up_n: float
    friction_n: float
    let_off_n: float
    dip_m: float
    press: Press

    def curve(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Dip (m) and force (N) of the press and of the release, force averaged over `SMOOTH`."""
        branches = []
        force = _smooth(self.press)
        moving = np.gradient(self.press.dip_m, self.press.time_s)
        for leg, sign in ((0, 1.0), (1, -1.0)):
            on = (self.press.leg == leg) & (sign * moving > 0.5 * PRESS_SPEED)
            branches.append((self.press.dip_m[on], force[on]))
        return branches[0], branches[1]


def _smooth(press: Press) -> Array:
    width = max(1, round(SMOOTH / (press.time_s[1] - press.time_s[0])))
    padded = np.pad(press.force_n, (width // 2, width - 1 - width // 2), mode="edge")
    out: Array = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
    return out


def weigh(action: Action) -> Weights:
    """Press the key slowly to first touch of its felt and let it up again.

    Parameters
    ----------
    action : parameter set

    Returns
    -------
    Weights
        Down weight, up weight, friction weight and let-off peak, N, and the press itself.

    Raises
    ------
    InputError : the key has no dip
    StaticsError, IntegrationError : the action has no rest state or cannot be pressed

    Examples
    --------
    >>> import model
    >>> print(f"{model.touch.weigh(model.load_action('hirschkorn2004')).down_n:.2f} N")
    0.45 N
    """
    rest = hand_set_rest(action)
    dip = at_rest(action, rest)["dip"]
    if not dip > 1e-4:
        raise InputError(
            f"{action.origin}: key dip found {1e3 * dip:.2f} mm, allowed above 0.1; lower contact02.first.y"
        )
    press = slow_press(action, rest, [dip, 0.0], speed_m_per_s=PRESS_SPEED, hold_s=HOLD)
    middle = (press.dip_m > MIDDLE[0] * dip) & (press.dip_m < MIDDLE[1] * dip)
    down, up = (float(np.median(press.force_n[middle & (press.leg == leg)])) for leg in (0, 1))
    late = (press.dip_m >= MIDDLE[1] * dip) & (press.leg == 0)
    peak = float(_smooth(press)[late].max()) if late.any() else math.nan
    return Weights(down, up, 0.5 * (down - up), peak, dip, press)
