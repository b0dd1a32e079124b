"""Touch of one action: weights from a slow press, hammer speeds for several forces, fastest repetition; table rows.

Repetition: blows are pulses F sin^2(pi f t) of the force on the key, so that the finger is off the key for an instant
between two. An action follows a rate if every blow of a steady series brings the hammer to the string with one of the
strengths `PEAKS`, as a player finds the right one. The result is the highest rate f (blows per second) such that it and
every slower rate tried is followed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import ArrayRecord, as_numbers
from model.force_driven import simulate
from model.parameters.action import Action, ActionLike, as_action
from model.scene.selection import choice_of
from model.simulation.hand_set_rest import hand_set_rest
from model.simulation.run import State
from model.tolerance import DEFAULT_TOLERANCE
from model.touch.check_load import CheckLoad, check_loads
from model.touch.hammer_speed import FORCES, SAMPLE, hammer_speeds, string_contact_starts
from model.touch.weights import Weights, weigh

Array = NDArray[np.float64]

PEAKS = (3.0, 4.0, 5.0)  # N
SLOWEST, FASTEST, COARSE, FINE = 3.0, 30.0, 1.0, 0.1  # blows/s
COARSE_RAD = 10.0 * DEFAULT_TOLERANCE  # some hundred series are played for one rate
BLOWS, SETTLING = 8, 2  # blows of a series, of which the first are not counted
POINTS = 32  # of the force per blow


def strikes_string(
    action: Action, rate_hz: float, peak_n: float, rest_rad: NDArray[np.float64] | None = None
) -> NDArray[np.bool_]:
    """Which of `BLOWS` blows (BLOWS,), pulses of force (sine squared) up to ``peak_n``, N, at ``rate_hz``, bring the
    hammer to the string; from ``rest_rad`` (n,) or, None, as a hand sets it up."""
    end = BLOWS / rate_hz
    times = np.linspace(0.0, end, BLOWS * POINTS + 1)
    force = peak_n * np.sin(np.pi * rate_hz * times) ** 2
    output = np.arange(math.floor(end / SAMPLE) + 1) * SAMPLE
    rest = hand_set_rest(action) if rest_rad is None else rest_rad
    start = State(0.0, rest.copy(), np.zeros(len(rest)))
    played = simulate(action, times, force, initial=start, output_time_s=output[output <= end], tolerance=COARSE_RAD)
    height = played.hammer_height_m
    blow = np.minimum((output[string_contact_starts(height)] * rate_hz).astype(int), BLOWS - 1)
    out = np.zeros(BLOWS, dtype=bool)
    out[blow] = True
    return out


def fastest_repetition(action: ActionLike, peaks_n: ArrayLike = PEAKS) -> float:
    """Highest rate (1/s, to 0.1) of a series of equal blows at which, for one of the peak forces ``peaks_n``, N, every
    blow (but the first few) reaches the string; NaN where none does.

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
    InputError : the scene lacks a body or is not driven by a force
    StaticsError, IntegrationError : the action has no rest state or cannot be simulated

    Examples
    --------
    >>> import model
    >>> model.touch.fastest_repetition(model.load_action("hirschkorn2004"))
    4.5
    """
    action = as_action(action)
    choice_of(action).need_played_key(action.name)
    peaks, rest = as_numbers(peaks_n, "strengths of the blows", 1).tolist(), hand_set_rest(action)

    def follows(rate: float) -> bool:
        for i, peak in enumerate(peaks):
            if strikes_string(action, rate, peak, rest)[SETTLING:].all():
                peaks.insert(0, peaks.pop(i))  # the next rate likely needs the same
                return True
        return False

    good, rate = math.nan, SLOWEST
    while rate <= FASTEST and follows(rate):
        good, rate = rate, rate + COARSE
    if math.isnan(good) or rate > FASTEST:
        return good
    while rate - good > 1.5 * FINE:
        middle = round(0.5 * (good + rate) / FINE) * FINE
        good, rate = (middle, rate) if follows(middle) else (good, middle)
    return round(good, 6)


@dataclass(frozen=True)
class Touch(ArrayRecord):
    """Touch of one action.

    Attributes
    ----------
    name : of the action
    weights : from a slow press and release
    blow_n, hammer_m_per_s : (k,) force of the blow and speed of the hammer at the string, NaN where it does not reach
    it
    repetition_hz : fastest repetition, NaN where it follows no rate
    gravity : m/s^2, to express weights in grams
    check_load : (k,) what the back check takes from each rising hammer, None where it takes nothing
    """

    name: str
    weights: Weights
    blow_n: NDArray[np.float64]
    hammer_m_per_s: NDArray[np.float64]
    repetition_hz: float
    gravity: float
    check_load: tuple[CheckLoad | None, ...] = ()

    def rows(self) -> dict[str, float]:
        """All results but the curve: value by name with its unit, in the order of the table."""
        w = self.weights
        out = {"key dip, mm": 1e3 * w.dip_m}
        for name, (force, u) in w.rows().items():
            out[f"{name}, N"], out[f"u of {name}, N"] = force, u
            out[f"{name}, g"] = 1e3 * force / self.gravity
        for force, speed in zip(self.blow_n, self.hammer_m_per_s, strict=True):
            out[f"hammer at {force:g} N, m/s"] = float(speed)
        out["fastest repetition, 1/s"] = self.repetition_hz
        return out

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is not steady, jams or cannot be measured, a sentence each."""
        loads = zip(self.blow_n[: len(self.check_load)], self.check_load, strict=True)
        return (*self.weights.remarks, *(f"{force:g} N: {load}" for force, load in loads if load is not None))

    def _repr_html_(self) -> str:
        import pandas as pd  # start-up: 0.6 s, only a notebook's display needs it

        return str(pd.DataFrame({self.name: self.rows()}).to_html(float_format="{:.3g}".format))


def measure_touch(
    action: ActionLike,
    forces_n: ArrayLike = FORCES,
    name: str | None = None,
    progress: Callable[[str], None] | None = None,
) -> Touch:
    """Measure the touch of an action: weights in a slow press, N, hammer speeds, m/s, for blows of each of
    ``forces_n``, N, fastest repetition, 1/s; ``progress`` is called with a short text at each step.

    Parameters
    ----------
    action : parameter set
    forces_n : forces of the blows, N
    name : what to call it, by default the name of the set
    progress : called with a short text at each step

    Returns
    -------
    Touch
        Weights, N, hammer speeds, m/s, and repetition, 1/s; `Touch.rows` names them all with units.

    Raises
    ------
    InputError : the key has no dip
    StaticsError, IntegrationError : the action has no rest state or cannot be pressed

    Examples
    --------
    >>> import model
    >>> touch = model.measure_touch(model.load_action("hirschkorn2004-regulated"), forces_n=[5.0])
    >>> print(f"{touch.weights.down_n:.2f} N down, {touch.repetition_hz:.1f} blows a second")
    0.44 N down, 12.3 blows a second
    """
    action = as_action(action)
    forces, say = as_numbers(forces_n, "forces of the blows", 1), progress or (lambda _: None)
    say("slow press")
    weights = weigh(action)
    say("blows")
    speeds = hammer_speeds(action, forces)
    say("repetition")
    return Touch(
        name=action.name if name is None else name,
        weights=weights,
        blow_n=forces,
        hammer_m_per_s=speeds,
        repetition_hz=fastest_repetition(action),
        gravity=action["gravity.g"],
        check_load=check_loads(action, forces),
    )
