"""What every stage agrees on: the array type, the order of bodies and channels, the number of worker threads.

Angles are in rad, counter-clockwise. A table of absolute angles has one column for each of `BODIES`; encoder angles
have one for each of `ENCODER_CHANNELS`, whatever the order in the recorded file.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

BODIES = ("key", "whippen", "jack", "repetition", "hammer")
KEY, WHIPPEN, JACK, REPETITION, HAMMER = range(5)
ENCODER_CHANNELS = ("key", "whippen", "hammer")
FILM_CHANNELS = ("jack", "repetition")
CHANNEL_GROUPS = ((ENCODER_CHANNELS, "encoder"), (FILM_CHANNELS, "film"))
ENCODER_BODIES = [BODIES.index(name) for name in ENCODER_CHANNELS]

LEVEL = 0.05  # of a test: probability of a false alarm, where nothing else is said
CONFIDENCE = 1.0 - LEVEL  # of an interval or a band
SIGMAS = 5.0  # standard uncertainties: Gaussian errors go beyond once in two million
RECTANGULAR = 12.0**-0.5  # standard deviation of a uniform distribution, of its width
WORKERS = 2  # threads: simulations and warping paths run without the interpreter's lock


def rms(values: ArrayLike) -> float:
    """Root mean square of the finite values; NaN without any."""
    known = np.asarray(values, dtype=float)
    known = known[np.isfinite(known)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
