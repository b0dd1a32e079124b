"""How many frames at the start of a film are still, judged by the poses of the bodies themselves.

A fit resolves motion of a hundredth of a pixel, long before grey values differ by more than their noise; a reference
that contains such frames would be smeared and its zero shifted.

Method: each pose coordinate of each body, over its standard uncertainty, is compared with the mean of the
frames before, alone and as the mean of the last 2, 4, 8 and 16 frames. The first window that differs by more
than `LIMIT` standard deviations ends the still run, one window's length and `GUARD` frames before that
window: a motion that starts gently is seen only some time after its start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

WINDOWS = (1, 2, 4, 8, 16)
LIMIT = 5.0
GUARD = 2
SCATTER_FRAMES = 12
FIRST, FIRST_LIMIT = 4, 8.0
"""With fewer frames before it, only gross motion ends the run."""


def still_count(pose: NDArray[np.float64], u_pose: NDArray[np.float64]) -> int:
    """Number of still frames at the start.

    Parameters
    ----------
    pose : ndarray, shape (n, k)
        Pose coordinates of all bodies, frame by frame; NaN where lost.
    u_pose : ndarray, shape (n, k)
        Standard uncertainty of each, from that frame's noise.

    Returns
    -------
    int
        Between 1 and n.
    """
    n = len(pose)
    if n < 2 or np.any(np.isnan(pose[0])):
        return 1
    typical = np.sqrt(np.nanmean(u_pose**2, axis=0))
    if n >= SCATTER_FRAMES:
        # the actual scatter of the poses from frame to frame, where that is more (compressed film); taken from the
        # smallest quarter of the steps, so that later motion does not count
        step = np.nanquantile(np.abs(np.diff(pose, axis=0)), 0.25, axis=0)
        typical = np.maximum(typical, step / (0.3186 * np.sqrt(2.0)))
    total = np.vstack([np.zeros(pose.shape[1]), np.cumsum(np.nan_to_num(pose), axis=0)])
    for end in range(2, n + 1):
        if np.any(np.isnan(pose[end - 1])):
            # a body that cannot be found is not known to be still
            return end - 1
        for window in WINDOWS:
            start = end - window
            if start < 1:
                break
            late = (total[end] - total[start]) / window
            early = total[start] / start
            spread = typical * np.sqrt(1.0 / window + 1.0 / start)
            limit = LIMIT if start >= FIRST else FIRST_LIMIT
            if np.any(np.abs(late - early) > limit * spread):
                return max(1, start - window - GUARD)
    return n
