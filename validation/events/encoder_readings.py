"""Readings of an encoder that its body cannot have made: jumps from one sample to the next, and standing still.

A *jump* is a step between two samples that lies outside the two steps before and the two after it. The steps of a
moving body change smoothly, also at a stop or a string: outside of its neighbours a step lies by some
`THIRD_DIFFERENCE` × (time between samples)³ at most. A *standstill* is a count that stays the same for `LEAST_S` and
either begins or ends with a step that no body takes from or to rest within one sample, or lasts while the prediction
and, of key and whippen, the other one of the two move, and begins or ends at speed.
Two readings are compared in each: a jump with the other encoders at that sample, a standstill as above. A count that
stays the same while its body rests reads what it should: that an encoder is frozen there cannot be seen, and what it
reads is right. Nor is seen what a frozen encoder misses below the limits: at 5 kHz 0.2 mrad from the begin of its
standstill to the end, and 2 mrad of vibration between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from validation.conventions import ENCODER_CHANNELS, Array
from validation.events.crossings import find_equal_runs
from validation.measurement.trial import MeasuredTrial
from validation.prediction.predict_session import PredictedAngles

THIRD_DIFFERENCE = 4e7  # rad/s³; the hammer of a loud blow with a shank of 250 Hz has 3.3e7
FEWEST_COUNTS = 6.0  # steps are rounded to counts: each of five is off by one at most
NOISE_SIGMAS = 8.0  # of single readings, of which a record has ten thousands, with noise that has tails
FROM_REST = 3e3  # rad/s²: largest step from or to rest over (time between samples)²; a fortissimo has a sixth of it
FEWEST_FROM_REST = 4.0  # counts; of 9,600 standstills of sound encoders none is left or entered by more than 2 at 5 kHz
LEAST_S = 4e-3  # 20 samples at 5 kHz: a slow key stays on one count for less
MOVES_RAD = 2e-3  # least turn that tells a motion: felts and play make the smaller ones
EDGE_S = 1e-3  # before and after a standstill: choice, a contact's time
EDGE_RAD = 3e-3  # in `EDGE_S`: a back check stops the hammer within five times that
MATCHES = 0.5  # of a leap: so nearly has its body moved, in the model, while the count stood still before it
APART_S = 0.06  # a leap forth and one back within this belong together


@dataclass(frozen=True)
class ReadingFault:
    """A jump or standstill of one encoder."""

    channel: str
    at_s: float  # of the first wrong sample
    until_s: float  # of the sample that is right again; NaN after a leap that stays
    # size of the first leap with its sign; of a standstill that ends in a leap, of that one; 0 without one
    leap_rad: float
    still_s: float  # how long the count stays the same; 0 for a leap alone
    limit_rad: float  # smallest leap that is found there; of a standstill without one, the motion of its body meanwhile
    stop_rad: float = 0.0  # of a standstill, the last step before it where no body stops so within one sample; 0 else
    is_alone: bool = True  # whether no other encoder leaps at that sample


def measure_step_excess(
    change_rad: Array, time_s: Array, resolution_rad: float, quiet_stop: int
) -> tuple[Array, float]:
    """Amount (n − 1,), rad, signed, by which each step between samples of ``change_rad`` (n,) exceeds its four
    neighbours, 0 within them, and the limit, rad, above which it is a leap; ``quiet_stop``: samples at rest, which tell
    the noise."""
    steps = np.diff(change_rad)
    out = np.zeros(steps.size)
    if steps.size < 5:  # one step and its four neighbours
        return out, float("inf")
    beside = np.stack([steps[:-4], steps[1:-3], steps[3:-1], steps[4:]])
    inner = steps[2:-2]
    out[2:-2] = np.maximum(inner - beside.max(axis=0), 0.0) - np.maximum(beside.min(axis=0) - inner, 0.0)
    dt = float(np.median(np.diff(time_s)))
    return out, FEWEST_COUNTS * resolution_rad + _estimate_rest_noise(steps, quiet_stop) + THIRD_DIFFERENCE * dt**3


def measure_step_from_rest(m: MeasuredTrial, expected: Array, i: int) -> tuple[Array, float]:
    """Steps (n − 1,), rad, of the i-th encoder that begin or end a standstill, 0 elsewhere, and the limit (rad) above
    which no body makes one; ``expected``: the model's change of its angle (n,), rad.

    A motion that goes on beyond such a step, as of a key that is thrown off its rail, counts where the model moves by
    as much during the standstill.
    """
    change, resolution_rad, quiet_stop = m.change_rad[:, i], float(m.resolution_rad[i]), m.quiet.stop
    steps = np.diff(change)
    out = np.zeros(steps.size)
    dt = float(np.median(np.diff(m.time_s)))
    for first, last in _find_standstills(change, m.time_s):
        extent = float(np.ptp(expected[first : last + 1]))
        for at, side in ((first - 1, -1), (last, 1)):
            if 0 <= at < steps.size and (not _is_continued(steps, at, side) or extent >= abs(steps[at])):
                out[at] = steps[at]
    return out, FEWEST_FROM_REST * resolution_rad + _estimate_rest_noise(steps, quiet_stop) + FROM_REST * dt**2


def _estimate_rest_noise(steps: Array, quiet_stop: int) -> float:
    at_rest = steps[: max(quiet_stop - 1, 0)]
    return NOISE_SIGMAS * float(at_rest.std()) if at_rest.size > 2 else 0.0


def _find_standstills(change: Array, time_s: Array) -> list[tuple[int, int]]:
    """First and last sample of each stretch of `LEAST_S` or more in which the reading stays the same."""
    starts, ends = find_equal_runs(change)
    long = time_s[ends] - time_s[starts] >= LEAST_S
    return [(int(first), int(last)) for first, last in zip(starts[long], ends[long], strict=True)]


def find_reading_faults(m: MeasuredTrial, p: PredictedAngles) -> list[ReadingFault]:
    """First fault, a jump between two samples or a standstill while its body moves, of each encoder of a trial that has
    one, in the order of the encoders; ``p``: the prediction, which tells where a body moves. At most one an encoder."""
    leaps = [_find_leaps(m, p.change_rad(name), i) for i, name in enumerate(ENCODER_CHANNELS)]
    found: list[ReadingFault] = []
    for i, name in enumerate(ENCODER_CHANNELS):
        still = _find_standstill(m, p, i)
        size, limit = leaps[i]
        at = np.flatnonzero(size)
        fault = _describe_leap(m, p.change_rad(name), i, size, float(limit[at[0]])) if at.size else None
        if still is not None and (fault is None or (still.at_s <= fault.at_s and not fault.still_s)):
            fault = still
        elif fault is not None:
            others = [leaps[j][0][at[0]] for j in range(len(ENCODER_CHANNELS)) if j != i]
            fault = replace(fault, is_alone=not any(others))
        if fault is not None:
            found.append(fault)
    return found


def are_simultaneous(faults: Sequence[ReadingFault], time_s: Array) -> bool:
    """Whether several encoders leap at one sample: then it is time that is lacking, not counts."""
    step = float(np.median(np.diff(time_s)))
    times = [fault.at_s for fault in faults if fault.leap_rad and not fault.still_s]
    return len(times) > 1 and max(times) - min(times) < 1.5 * step


def _find_leaps(m: MeasuredTrial, expected: Array, i: int) -> tuple[Array, Array]:
    """Steps of the i-th encoder that are leaps, rad, 0 else, (n − 1,), and the limit of each."""
    excess, limit = measure_step_excess(m.change_rad[:, i], m.time_s, float(m.resolution_rad[i]), m.quiet.stop)
    step, limit_from_rest = measure_step_from_rest(m, expected, i)
    excess, step = np.where(np.abs(excess) > limit, excess, 0.0), np.where(np.abs(step) > limit_from_rest, step, 0.0)
    return np.where(excess != 0.0, excess, step), np.where(excess != 0.0, limit, limit_from_rest)


def _describe_leap(m: MeasuredTrial, expected: Array, i: int, leaps_rad: Array, limit: float) -> ReadingFault:
    """First leap of the ``i``-th encoder, or the standstill that it begins or ends; ``leaps_rad`` (n − 1,): steps that
    are leaps, 0 elsewhere, ``limit``: from which one is, ``expected`` (n,): the model's change of the angle; all rad.

    It begins one where the encoder moves as fast before it, and ends one where the body moved by so much meanwhile.
    """
    name, time_s, change = ENCODER_CHANNELS[i], m.time_s, m.change_rad[:, i]
    steps, at = np.diff(change), np.flatnonzero(leaps_rad)
    leap = int(at[0])
    for first, last in _find_standstills(change, time_s):
        if leap not in (first - 1, last):
            continue
        until = min(last + 1, change.size - 1)
        moved, by = float(expected[until] - expected[first]), float(change[until] - change[first])
        stop = float(steps[leap]) if leap == first - 1 and _is_continued(steps, leap, -1) else 0.0
        leaves = last < steps.size and bool(leaps_rad[last])
        caught_up = leaves and (abs(moved - by) < MATCHES * abs(by) or _is_continued(steps, last, 1))
        if stop or (leap == last and caught_up):
            still_s, ends = float(time_s[last] - time_s[first]), float(steps[last]) if leaves else 0.0
            return ReadingFault(name, float(time_s[first]), float(time_s[until]), ends, still_s, limit, stop)
    back = [k for k in at[1:] if leaps_rad[k] * leaps_rad[leap] < 0 and time_s[k] - time_s[leap] < APART_S]
    until_s = float(time_s[back[0] + 1]) if back else float("nan")
    return ReadingFault(name, float(time_s[leap + 1]), until_s, float(leaps_rad[leap]), 0.0, limit)


def _is_continued(steps: Array, at: int, side: int) -> bool:
    """Whether a step is like its neighbour on one side: the body moves at that speed there."""
    beside = steps[at + side] if 0 <= at + side < steps.size else 0.0
    return bool(abs(beside - steps[at]) < MATCHES * abs(steps[at]))


def _find_standstill(m: MeasuredTrial, p: PredictedAngles, i: int) -> ReadingFault | None:
    """First standstill of the ``i``-th encoder without a leap: its reading stays while the model moves and the other of
    key and whippen does (for the hammer: while it stops or starts abruptly); None if there is none."""
    change, time_s = m.change_rad[:, i], m.time_s
    name, expected = ENCODER_CHANNELS[i], p.change_rad(ENCODER_CHANNELS[i])
    reach = max(round(EDGE_S / float(np.median(np.diff(time_s)))), 1)
    for first, last in _find_standstills(change, time_s):
        part = slice(first, last + 1)
        if first < m.quiet.stop or last == change.size - 1:
            continue
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
                name, float(time_s[first]), float(time_s[last]), 0.0, float(time_s[last] - time_s[first]), MOVES_RAD
            )
    return None
