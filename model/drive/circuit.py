"""Torque of a motor under a recorded command and a recorded motion, by what a log can tell of its circuit.

With m = k i the torque, D the resistance R plus the gain of the current loop Z:

    delay dm/dt = S(source - (1 - share) m - firmness (m - lim(m))) - share m - damping w,

torque_per_volt = k g (torque mode) or k g / D (voltage mode), delay = L / D, damping = k^2 / D, ceiling = k I (lim),
supply = U k / D (S), share = R / D, which is 1 in voltage mode, firmness = limit_gain / D. Nothing else of the drive
shows in a torque.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from model.kernels.drive_torque import SUBSTEPS, torque_along

Array = NDArray[np.float64]
LUMPS = ("torque_per_volt", "delay", "damping", "ceiling", "supply", "share", "firmness")
SATURATED = 2.0  # as `model.scene.pressing`


def motor_torque(
    lumps: Array, command_v: Array, arm_rad: Array, interval_s: float, mode: str, softness: float
) -> Array:
    """Torque (p, k), N m, at the samples and `SUBSTEPS` - 1 times between, for rows (p, 7) as ``LUMPS``.

    The command is held from sample to sample; the motor begins as if its first command had lasted. Of the motion only
    angles are taken: the back-EMF of a substep is what the arm turned in it, so that nothing is differentiated.
    """
    rows = np.ascontiguousarray(lumps, dtype=float)
    largest = rows[:, 3] if mode == "torque" else SATURATED * rows[:, 4]
    out = np.empty((len(rows), (len(command_v) - 1) * SUBSTEPS + 1))
    turned = _between(arm_rad, SUBSTEPS)
    torque_along(rows, np.ascontiguousarray(largest), command_v, turned, interval_s, softness, out)
    return out


def _between(x: Array, parts: int) -> Array:
    """``x`` (n,) and ``parts`` - 1 values between each two samples, by cubics through four of them."""
    slope = 0.5 * np.diff(np.concatenate([[2.0 * x[0] - x[1]], x, [2.0 * x[-1] - x[-2]]]))
    slope = slope[:-1] + slope[1:]
    at = (np.arange(parts) / parts)[None, :]
    left, right, rise, fall = x[:-1, None], x[1:, None], slope[:-1, None], slope[1:, None]
    cubic = (1 + 2 * at) * (1 - at) ** 2 * left + at**2 * (3 - 2 * at) * right
    cubic += at * (1 - at) ** 2 * rise + at**2 * (at - 1) * fall
    return np.append(cubic.ravel(), x[-1])
