"""When is the action at rest again: encoders still, force back where it was before the blow.

Place in the data flow: the recorder asks after each block whether a trial may end. Encoders are still when each
stays within ±``counts`` of one value for the whole window; the force is back when its mean over the window is
within a band about its mean over the quiet time before the blow. A body that rests a little off its first position
(friction) is at rest all the same.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class RestDetector:
    """Looks at the last ``window`` samples once sample ``earliest`` has passed.

    Parameters
    ----------
    window : int
        Samples that must be at rest.
    earliest : int
        First sample that may belong to the rest.
    baseline : int
        Samples at the beginning of the trial whose mean force is the reference.
    counts : int
        Allowed deviation of each encoder from the middle, counts.
    force_n : float
        Half width of the band for the mean force, N.
    """

    def __init__(self, *, window: int, earliest: int, baseline: int, counts: int, force_n: float) -> None:
        self._window, self._earliest, self._baseline = window, earliest, baseline
        self._counts, self._force_n = counts, force_n

    def at_rest(self, force_n: NDArray[np.float64], encoder_count: NDArray[np.int64]) -> bool:
        """Tell whether the trial so far, force (n,) and counts (n, 3), ends with a whole window at rest."""
        n = force_n.shape[0]
        if n < self._earliest + self._window or n < self._baseline:
            return False
        last = encoder_count[n - self._window :]
        if np.any(last.max(axis=0) - last.min(axis=0) > 2 * self._counts):
            return False
        drift = force_n[n - self._window :].mean() - force_n[: self._baseline].mean()
        return bool(abs(drift) <= self._force_n)
