"""Readings of an encoder that its body cannot have made: jumps from one sample to the next, and standing still.

A *jump* is a step between two samples that lies outside the two steps before and the two after it. The steps of a
moving body change smoothly, also at a stop or a string: outside of its neighbours a step lies by some
`THIRD_DIFFERENCE` × (time between samples)³ at most. A *standstill* is a count that stays the same for `LEAST_S` while
the prediction and, of key and whippen, the other one of the two move, and that begins or ends at full speed.
Two readings are compared in each: a jump with the other encoders at that sample, a standstill as above.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from validation.conventions import ENCODER_CHANNELS, Array
from validation.measurement.trial import MeasuredTrial
from validation.prediction.predict_session import PredictedAngles

THIRD_DIFFERENCE = 4e7  # rad/s³; the hammer of a loud blow with a shank of 250 Hz has 3.3e7
FEWEST_COUNTS = 6.0  # steps are rounded to counts: each of five is off by one at most
NOISE = 8.0  # standard deviations of the steps at rest
LEAST_S = 4e-3
MOVES_RAD = 2e-3
EDGE_S = 1e-3
EDGE_RAD = 3e-3  # in `EDGE_S`: a back check stops the hammer within five times that
APART_S = 0.06  # a leap forth and one back within this belong together


@dataclass(frozen=True)
class ReadingFault:
    """A jump or standstill of one encoder.

    Attributes
    ----------
    channel : str
    at_s : float
        Of the first wrong sample.
    until_s : float
        Of the sample that is right again; NaN after a leap that stays.
    leap_rad : float
        Size of the first leap with its sign; of a standstill that ends in a leap, of that one; 0 without one.
    still_s : float
        How long the count stays the same; 0 for a leap alone.
    limit_rad : float
        Smallest leap that is found in this trial.
    """

    channel: str
    at_s: float
    until_s: float
    leap_rad: float
    still_s: float
    limit_rad: float


def leaps(change_rad: Array, time_s: Array, resolution_rad: float, quiet_stop: int) -> tuple[Array, float]:
    """By how much each step lies outside of its neighbours, rad, signed, (n − 1,), and the limit of what is one."""
    steps = np.diff(change_rad)
    out = np.zeros(steps.size)
    if steps.size < 5:
        return out, float("inf")
    beside = np.stack([steps[:-4], steps[1:-3], steps[3:-1], steps[4:]])
    inner = steps[2:-2]
    out[2:-2] = np.maximum(inner - beside.max(axis=0), 0.0) - np.maximum(beside.min(axis=0) - inner, 0.0)
    dt = float(np.median(np.diff(time_s)))
    at_rest = steps[: max(quiet_stop - 1, 0)]
    noise = float(at_rest.std()) if at_rest.size > 2 else 0.0
    return out, FEWEST_COUNTS * resolution_rad + NOISE * noise + THIRD_DIFFERENCE * dt**3


def reading_faults(m: MeasuredTrial, p: PredictedAngles) -> list[ReadingFault]:
    """Jumps and standstills of all encoders of a trial, the first of each encoder in time."""
    found: list[ReadingFault] = []
    for i, name in enumerate(ENCODER_CHANNELS):
        change = m.change_rad[:, i]
        size, limit = leaps(change, m.time_s, float(m.resolution_rad[i]), m.quiet.stop)
        at = np.flatnonzero(np.abs(size) > limit)
        still = _standstills(m, p, i)
        fault = _leap(name, m.time_s, change, size, at, limit) if at.size else None
        if still is not None and (fault is None or still.at_s <= fault.at_s):
            fault = still if fault is None else _held(still, fault)
        if fault is not None:
            found.append(fault)
    return found


def simultaneous(faults: Sequence[ReadingFault], time_s: Array) -> bool:
    """Whether several encoders leap at one sample: then it is time that is lacking, not counts."""
    step = float(np.median(np.diff(time_s)))
    times = [fault.at_s for fault in faults if fault.leap_rad and not fault.still_s]
    return len(times) > 1 and max(times) - min(times) < 1.5 * step


def _leap(name: str, time_s: Array, change: Array, size: Array, at: NDArray[np.intp], limit: float) -> ReadingFault:
    first = int(at[0])
    held = first
    while held > 0 and change[held] == change[held - 1]:
        held -= 1
    still_s = float(time_s[first] - time_s[held])
    if still_s >= LEAST_S:  # a count that stays and then leaps to where the body has got to
        return ReadingFault(name, float(time_s[held]), float(time_s[first + 1]), float(size[first]), still_s, limit)
    back = [k for k in at[1:] if size[k] * size[first] < 0 and time_s[k] - time_s[first] < APART_S]
    until = float(time_s[back[0] + 1]) if back else float("nan")
    return ReadingFault(name, float(time_s[first + 1]), until, float(size[first]), 0.0, limit)


def _held(still: ReadingFault, leap: ReadingFault) -> ReadingFault:
    return leap if leap.still_s else still


def _standstills(m: MeasuredTrial, p: PredictedAngles, i: int) -> ReadingFault | None:
    change, time_s = m.change_rad[:, i], m.time_s
    expected = p.change_rad(ENCODER_CHANNELS[i])
    edges = np.flatnonzero(np.diff(change) != 0)
    starts, ends = np.concatenate([[0], edges + 1]), np.concatenate([edges, [change.size - 1]])
    reach = max(round(EDGE_S / float(np.median(np.diff(time_s)))), 1)
    for first, last in zip(starts, ends, strict=True):
        if time_s[last] - time_s[first] < LEAST_S or first < m.quiet.stop or last == change.size - 1:
            continue
        part = slice(int(first), int(last) + 1)
        if not np.isfinite(expected[part]).all() or np.ptp(expected[part]) < MOVES_RAD:
            continue
        before = abs(change[first] - change[max(first - reach, 0)])
        after = abs(change[min(last + 1 + reach, change.size - 1)] - change[last])
        abrupt = max(before, after) >= EDGE_RAD
        if i < 2:  # key and whippen carry each other
            other = m.change_rad[part, 1 - i]
            abrupt = bool(np.ptp(other) >= MOVES_RAD) and max(before, after) > 0.0
        if abrupt:
            return ReadingFault(
                ENCODER_CHANNELS[i], float(time_s[first]), float(time_s[last]), 0.0,
                float(time_s[last] - time_s[first]), MOVES_RAD,
            )  # fmt: skip
    return None
