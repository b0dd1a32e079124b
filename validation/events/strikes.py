"""Phases of a stroke by the motion of its key: rest, strike, hold, release; every strike of a repetition."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from validation.conventions import Array
from validation.events.crossings import find_runs

PHASES = ("rest", "strike", "hold", "release")
REST, STRIKE, HOLD, RELEASE = range(4)
STARTED, UP = 0.05, 0.1
"""Shares of the key's travel: a strike begins above the first; below the second the key is up."""
DOWN = 1.0 - UP
"""Share of the key's travel above which the key is down."""
AFTER_DOWN_S, AFTER_UP_S = 0.06, 0.25
"""The key is held when it has been down so long; it rests when it has been up so long."""
AGAIN = 0.15
"""A key that turns back by this share of its travel has been let go, or is pressed again."""


def find_key_phases(key_dip: Array, step_s: float) -> NDArray[np.int64]:
    """Phase of each sample, (n,): 0 rest, 1 strike, 2 hold, 3 release, from the dip of a key (n,), any unit, 0 at rest
    and positive down, sampled every ``step_s`` s. Each note of a repetition begins a new strike.

    A strike begins when the key leaves its rest. It becomes a hold when the key has stayed down for a while, a release
    when the key has turned back by `AGAIN`, held or not; a key that turns round again by as much before it is up begins
    a new strike. So each note of a repetition is a strike of its own, though the key returns only part-way and is never
    held.
    """
    share = key_dip / max(float(key_dip.max()), 1e-9)
    out = np.zeros(share.size, dtype=np.int64)
    now, since, highest, lowest = REST, 0.0, 0.0, 1.0
    for k, x in enumerate(share):
        since += step_s
        if now == REST and x > STARTED:
            now, since, highest = STRIKE, 0.0, x
        elif now == STRIKE:
            highest = max(highest, x)
            since = since if x > DOWN else 0.0
            if since > AFTER_DOWN_S:
                now = HOLD
            elif x < highest - AGAIN:
                now, since, lowest = RELEASE, 0.0, x
        elif now == HOLD and x < DOWN:
            now, since, lowest = RELEASE, 0.0, x
        elif now == RELEASE:
            lowest = min(lowest, x)
            since = since if x < UP else 0.0
            if x > lowest + AGAIN:
                now, since, highest = STRIKE, 0.0, x
            elif since > AFTER_UP_S:
                now = REST
        out[k] = now
    return out


STRUCK = 0.5
"""A strike brings the key down by more than this share of the stroke's deepest."""


def find_key_strikes(key_dip: Array, phases: NDArray[np.int64]) -> list[tuple[int, int]]:
    """First sample and end of every strike of a key (n,) with these phases (n,)."""
    return [
        (a, b) for a, b in find_runs(phases == STRIKE).tolist() if key_dip[a:b].max() > STRUCK * float(key_dip.max())
    ]
