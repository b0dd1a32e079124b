"""Averages of a signal, of its rate and of its second rate over the same short windows, without differentiating it.

A window w is a smooth bump; the average of x'' under w is that of x under w''. So force, torque and acceleration of a
log are filtered alike, and noise of an encoder enters as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

Array = NDArray[np.float64]
DEGREE = 5  # of the bump: its second derivative is smooth
QUARTIC = np.array([22.0, -67.0, -58.0, 0.0, 58.0, 67.0, -22.0]) / 252.0
PIECE = 3  # samples a piece of the bump


@dataclass(frozen=True)
class Windows:
    """Bumps of 18 samples, one every ``PIECE`` samples.

    Attributes
    ----------
    interval_s : of the samples
    """

    interval_s: float

    def averages(self, x: Array, rates: int = 0, parts: int = 1) -> Array:
        """Average (m,) of the derivative of order ``rates`` of ``x`` (n,), or of each row (p, n), under each window.

        With ``parts`` there are that many values to a sample interval: sums over the samples of a torque that has a
        kink at each of them would be off its integral, by an apparent delay of a twelfth of the interval's square over
        the drive's own.
        """
        step = self.interval_s / parts
        bump = BSpline.basis_element(np.arange(DEGREE + 2) * PIECE * self.interval_s)
        at = np.arange(1, (DEGREE + 1) * PIECE * parts) * step
        weights = (-1.0) ** rates * bump.derivative(rates)(at) if rates else bump(at)
        weights = weights / np.sum(bump(at))
        rows = np.pad(np.atleast_2d(x), ((0, 0), (parts - 1, parts - 1)), mode="edge")
        count = ((np.shape(x)[-1] - 1) // parts + 1 - (DEGREE + 1) * PIECE + 1) // PIECE + 1
        out = np.stack([np.convolve(row, weights[::-1], "valid")[:: PIECE * parts] for row in rows])[:, :count]
        return out[0] if np.ndim(x) == 1 else out

    def speed(self, x: Array) -> Array:
        """Rate (n,) of ``x`` at its samples: slope of a quartic through seven of them, which keeps what rings."""
        slope = np.convolve(np.pad(x, 3, mode="edge"), QUARTIC[::-1], "valid")
        return np.asarray(slope / self.interval_s)
