"""Sample times that a file states: a clock, or a column of times, compared with each other sample by sample.

Text rounds times. Rounding is not taken for jitter, as long as a lost sample would still show.
"""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigInputError

JITTER = 0.02  # of the spacing, that a time may be off even spacing; a lost sample is off by 1
DRIFT = 1e-4  # relative, of two clocks that count the same samples; crystals differ by half of it
COARSE = 0.45  # of the spacing: times rounded by more no longer show one lost sample
ROUNDING = 1.01  # times the last digit, that a difference of two rounded times may be off: and binary's own
UNEVEN_SHARE = 0.1  # of the steps: a column of times or numbers may have breaks in so many
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units a channel of times may have."""
TIME_NAMES = re.compile(
    r"(t|times?|zeit|temps|tiempo|tempo|tijd|timestamps?|x_value|elapsed( time)?)"
    r"[ _/]*[(\[]?(?P<unit>s|ms|us|ns)?[)\]]?",
    re.IGNORECASE,
)
"""Names of a column of times, with or without a unit."""
SAMPLE_NAMES = re.compile(
    r"time|zeit|temps|tiempo|tempo|tijd|stamp|clock|second|uhr|datum|date|sample|scan|record|index|messwert|"
    r"\b(no|nr|row|line|pt|point|n|i|x|#)\b",
    re.IGNORECASE,
)
"""Words in the names of columns that number the samples or tell their times."""


class Clock(NamedTuple):
    """Sample times of a channel as the file states them: sample k at ``start_s + k * interval_s`` after ``stamp_s``.

    ``stamp_s`` is the time of day or date it states beside, s from an origin of the file's; 0 where it states none.
    ``resolution_s`` is the decimal place the interval is written with; 0 where it is stated in binary.
    ``source`` is the property of the file that states it, where it has a name.
    """

    interval_s: float
    start_s: float = 0.0
    stamp_s: float = 0.0
    resolution_s: float = 0.0
    source: str = ""

    def agrees(self, interval_s: float) -> bool:
        """Whether the stated interval is this one to its number of digits: 0.000021 s may be 1/48000 s."""
        return abs(self.interval_s - interval_s) <= max(0.5 * ROUNDING * self.resolution_s, DRIFT * interval_s)

    @property
    def is_rounded(self) -> bool:
        """Whether the interval is known to its few digits only: its rate is no round number."""
        rate_hz = 1.0 / self.interval_s
        return 0.5 * self.resolution_s > DRIFT * self.interval_s and abs(float(f"{rate_hz:.5g}") / rate_hz - 1) > 1e-9


class BrokenTimes(RigInputError):
    """Times that do not follow each other by one interval."""


class CoarseTimes(RigInputError):
    """Times that are written in steps of about a sample interval or more."""


def even_interval(time_s: NDArray[np.float64], what: str) -> float:
    """Interval, s, of the even times (n,), s; RigInputError, which begins with ``what``, for times that do not rise,
    have a break, or are written too coarsely."""
    if time_s.size < 2:
        raise RigInputError(f"{what}: {time_s.size} samples, allowed from 2")
    steps = np.diff(time_s)
    step = float(time_s[-1] - time_s[0]) / (time_s.size - 1)
    if not step > 0:
        raise RigInputError(f"{what} does not rise; times must be in s and in order")
    if steps.min() < 0:
        refuse_break(time_s, typical_interval(time_s), what)
    uneven = np.abs(steps - step) / step
    # residuals of the line through the ends: jitter, rounding at both, and a step that changes
    away = np.abs(time_s - (time_s[0] + step * np.arange(time_s.size))) / step
    if max(uneven.max(), away.max()) <= JITTER:
        return step
    rounding = time_resolution(time_s) / step
    if rounding > COARSE and abs(np.median(steps) - step) > 0.25 * step:
        raise CoarseTimes(
            f"{what} is written in steps of {rounding * step:g} s, too coarse for samples every {step:g} s; "
            "give sample_rate_hz instead"
        )
    explained = 0.0 if rounding > COARSE else ROUNDING * rounding
    most = max(JITTER, explained)
    if uneven.max() > explained + JITTER or away.max() > most:
        refuse_break(time_s, typical_interval(time_s), what)
    return step


def typical_interval(time_s: NDArray[np.float64]) -> float:
    """Return the mean step of times, s, without those that differ from the median by half of it and more."""
    steps = np.diff(time_s)
    median = float(np.median(steps))
    return float(steps[np.abs(steps - median) <= 0.5 * abs(median) + time_resolution(time_s)].mean())


def is_mostly_even(values: NDArray[np.float64]) -> bool:
    """Whether nine steps in ten of a column are one step upwards, as those of times and of sample numbers are."""
    steps = np.diff(values)
    step = float(np.median(steps))
    return step > 0 and float(np.mean(np.abs(steps - step) > 0.5 * step)) < UNEVEN_SHARE


def refuse_break(time_s: NDArray[np.float64], interval_s: float, what: str) -> None:
    """Raise `BrokenTimes`, whose message begins with ``what`` and names the first row (from 1) whose time is not one
    interval after the row above, and by how much. Never returns."""
    steps = np.diff(time_s)
    allowed = JITTER * interval_s + ROUNDING * time_resolution(time_s)
    off = np.abs(steps - interval_s) > allowed
    row = int(np.argmax(off if off.any() else np.abs(steps - interval_s))) + 2
    ratio = float(steps[row - 2]) / interval_s if interval_s > 0 else np.inf
    said = f"{what} row {row}: {time_s[row - 1]:.9g} s comes after {time_s[row - 2]:.9g} s"
    if ratio <= 0.25:
        said += (
            f", the times go back by {1 - round(ratio)} samples: a block was written twice, or the clock was set back"
        )
    elif np.isfinite(ratio) and round(ratio) > 1 and abs(ratio - round(ratio)) < 0.25:
        said += f", samples are missing: {round(ratio) - 1}"
    else:
        said += f", {abs(ratio - 1):.3g} intervals off even spacing"
    raise BrokenTimes(said)


def check_times(time_s: NDArray[np.float64], interval_s: float, what: str) -> None:
    """Refuse (RigInputError, which begins with ``what``) times (n,), s, that are not those of samples every
    ``interval_s``, but for jitter, rounding and a drift of one sample or 1e-4.

    A slow drift is allowed because two clocks may have counted.
    """
    away = np.abs(time_s - time_s[0] - interval_s * np.arange(time_s.size))
    rounding = time_resolution(time_s)
    allowed = JITTER * interval_s + ROUNDING * rounding
    if away.max() <= allowed:
        return
    steps = np.diff(time_s)
    mean = float(time_s[-1] - time_s[0]) / steps.size
    typical = typical_interval(time_s)
    if abs(typical - interval_s) > max(allowed, JITTER * interval_s) or np.all(np.abs(steps - interval_s) <= allowed):
        if abs(mean - interval_s) <= max(interval_s / steps.size, DRIFT * interval_s):
            return
        raise RigInputError(
            f"{what} rises by {typical:.9g} s a sample, the stated rate means {interval_s:.9g} s; name it as "
            "time.channel, correct time.sample_rate_hz, or name it in time.ignore where it is no sample clock"
        )
    refuse_break(time_s, interval_s, what)


def find_breaks(time_s: NDArray[np.float64], interval_s: float) -> list[int]:
    """Return the samples that do not follow the one before them by one interval."""
    off = np.abs(np.diff(time_s) - interval_s) > 0.5 * interval_s + ROUNDING * time_resolution(time_s)
    return [int(at) + 1 for at in np.flatnonzero(off)]


def time_resolution(time_s: NDArray[np.float64]) -> float:
    """Last decimal place with which times (n,), s, are written, such as 0.001 s; at least their floating-point
    resolution."""
    floor = float(4 * np.spacing(np.abs(time_s).max()))
    for digits in range(9):
        resolution = 10.0**-digits  # s: one in the last decimal place
        if resolution < floor:
            break
        if np.all(np.abs(np.round(time_s, digits) - time_s) <= max(floor, 1e-15)):
            return resolution
    return floor
