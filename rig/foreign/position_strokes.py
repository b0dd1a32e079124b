"""Where the strokes of a long recording of positions begin and end.

In: displacements of all sensors on one clock. Out: `Cut`, sample ranges in order; a stroke that the recording begins or
ends with is marked as cut off. Levels of rest are those before each stroke: optical sensors drift.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SUSTAINED_S = 2e-3
"""How long a departure must hold: a spike is no stroke."""
FIRST_S = 0.01
"""Rest by which it is told when the first stroke leaves it, where it does so within the time kept before a stroke."""


@dataclass(frozen=True)
class Cut:
    """A stroke: samples ``first`` to ``end``, ``trigger`` the first beyond the level; ``cut_off`` is empty or says why
    it is not whole.
    """

    first: int
    trigger: int
    end: int
    cut_off: str = ""


def cut_strokes(
    displacement: Array, travel: Array, rate_hz: float, *, trigger: float, pre_s: float, rest_s: float
) -> list[Cut]:
    """Find the strokes.

    Parameters
    ----------
    displacement : ndarray, shape (n, k)
        Of k sensors, m.
    travel : ndarray, shape (k,)
        Length of each one's ruler, m.
    rate_hz : float
    trigger : float
        Departure from the level of rest that begins a stroke, as a share of the travel.
    pre_s, rest_s : float
        Time kept before, and how long all must be back at the end, s. Strokes with less than ``rest_s`` and half of
        ``pre_s`` between them are one trial: the second would have no rest to begin from.
    """
    share = displacement / travel
    pre = max(int(pre_s * rate_hz), 1)
    level = np.median(share[: max(round(FIRST_S * rate_hz), 1)], axis=0)
    if not np.any(np.abs(share[:pre] - level) > trigger):
        level = np.median(share[:pre], axis=0)
    if np.any(level > trigger):  # begins within a stroke: rest is where the sensors are lowest
        level = np.percentile(share, 2.0, axis=0)
    away = np.any(np.abs(share - level) > trigger, axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], away, [False]]).astype(np.int8)))
    runs = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    joined: list[list[int]] = []
    for begin, end in runs:
        if joined and begin - joined[-1][1] < (rest_s + pre_s / 2) * rate_hz:
            joined[-1][1] = end
        elif end - begin >= SUSTAINED_S * rate_hz or joined and begin == joined[-1][1]:
            joined.append([begin, end])
    cuts = []
    pre, rest = round(pre_s * rate_hz), round(rest_s * rate_hz)
    for k, (begin, end) in enumerate(joined):
        before = joined[k - 1][1] if k else 0
        after = joined[k + 1][0] if k + 1 < len(joined) else len(share)
        first = max(begin - pre, (before + rest) if k else 0, 0)
        reason = ""
        if end + rest > len(share):
            reason = "the recording ends during this stroke"
        elif begin < SUSTAINED_S * rate_hz:
            reason = "the recording begins during this stroke"
        cuts.append(Cut(min(first, begin), begin, min(end + rest, after, len(share)), reason))
    return cuts
