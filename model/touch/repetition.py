"""Fastest repetition of an action: the rate up to which every blow of a steady series brings the hammer to the string.

Blows are pulses F sin^2(pi f t) of the force on the key, so that the finger is off the key for an instant between two.
An action follows a rate if it does so with one of the strengths `PEAKS`, as a player finds the right one. The result is
the highest rate f (blows per second) such that it and every slower rate tried is followed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import as_numbers
from model.force_driven import simulate
from model.observables import hammer_height_from_angle
from model.parameters.action import BODIES, Action
from model.simulation.hand_set_rest import hand_set_rest
from model.simulation.run import State
from model.touch.hammer_speed import touches

PEAKS = (3.0, 4.0, 5.0)  # N
SLOWEST, FASTEST, COARSE, FINE = 3.0, 30.0, 1.0, 0.1  # blows/s
BLOWS, SETTLING = 8, 2  # blows of a series, of which the first are not counted
POINTS = 32  # of the force per blow
SAMPLE = 2e-4  # s


def sounded(
    action: Action, rate_hz: float, peak_n: float, rest_rad: NDArray[np.float64] | None = None
) -> NDArray[np.bool_]:
    """Which of `BLOWS` blows bring the hammer to the string, (BLOWS,); from ``rest_rad`` (5,) or the action's own."""
    end = BLOWS / rate_hz
    times = np.linspace(0.0, end, BLOWS * POINTS + 1)
    force = peak_n * np.sin(np.pi * rate_hz * times) ** 2
    output = np.arange(math.floor(end / SAMPLE) + 1) * SAMPLE
    rest = hand_set_rest(action) if rest_rad is None else rest_rad
    start = State(0.0, rest.copy(), np.zeros(len(BODIES)))
    played = simulate(action, times, force, initial=start, output_time_s=output[output <= end], tolerance=1e-4)
    height = hammer_height_from_angle(action, played.angle_rad[:, BODIES.index("hammer")])
    blow = np.minimum((output[touches(height)] * rate_hz).astype(int), BLOWS - 1)
    out = np.zeros(BLOWS, dtype=bool)
    out[blow] = True
    return out


def fastest_repetition(action: Action, peaks_n: ArrayLike = PEAKS) -> float:
    """Highest rate that the action follows.

    Parameters
    ----------
    action : parameter set
    peaks_n : strengths to try, N; one that works is enough

    Returns
    -------
    float
        Blows per second, to 0.1; NaN where the action does not follow the slowest rate.

    Raises
    ------
    StaticsError, IntegrationError : the action has no rest state or cannot be simulated

    Examples
    --------
    >>> import model
    >>> model.touch.fastest_repetition(model.load_action("hirschkorn2004"))
    4.5
    """
    peaks, rest = as_numbers(peaks_n, "strengths of the blows", 1).tolist(), hand_set_rest(action)

    def follows(rate: float) -> bool:
        return any(bool(sounded(action, rate, peak, rest)[SETTLING:].all()) for peak in peaks)

    good, rate = math.nan, SLOWEST
    while rate <= FASTEST and follows(rate):
        good, rate = rate, rate + COARSE
    if math.isnan(good) or rate > FASTEST:
        return good
    while rate - good > 1.01 * FINE:
        middle = round(0.5 * (good + rate) / FINE) * FINE
        good, rate = (middle, rate) if follows(middle) else (good, middle)
    return round(good, 6)
