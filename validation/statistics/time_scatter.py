"""Scatter of curves in time: how far the trials' curves are shifted, and where a mean curve may lie because of it.

Conventions: curves are (n_samples, n_trials), times in samples. Blows scatter in time: an event that comes later makes
a step, so that the values of a few trials at one instant are equal before it and far apart after it, and tell nothing
of how far the mean may lie off. Their shift in time does: near each instant it is the regression of a curve's deviation
on the slope of the mean curve (registration to first order).

A shift counts where it explains the deviations, where the body moves (a hundredth of its largest speed, clear of
rounding), and where it is shorter than half of the time the body takes at its fastest: a longer one is not told from
a difference in value. Delays are not made good before the action rests: the variance over time is the non-decreasing
one nearest to what is found at each instant, weighted with the squared slope, so that what looks like a delay of slow
creeping yields to what the next fast motion shows. The mean curve may lie wherever it comes when it is shifted by as
much as a further trial's shift may be (prediction interval of Student's t), since one trial in some that comes early
has its part in the mean. Curves without a motion in common have no scatter in time.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import convolve1d, maximum_filter1d
from scipy.optimize import isotonic_regression
from scipy.special import stdtrit

from validation.conventions import Array

WINDOW = 1 / 6  # of the time in which the mean curve would cover its range at its largest speed
LONGEST = 0.5  # of the same time: a longer shift is not told from a difference in value
MOVES = 0.01  # of the largest speed
EXPLAINED = 0.4  # of the squared deviations near an instant; half is what shifts explain of sharp steps
CLEAR = 3.0  # times the rounding of its samples, over the window, that a slope must exceed
IS_MOTION = 10.0  # times the variance of the mean's slope, all along: below, the mean is what is left of the scatter
TIME_CONFIDENCE = 0.995  # for a further trial; with it the band of the mean covers about 95 % on the virtual bench
ROUND_SAMPLES = 0.05


def time_scatter(curves: Array, u_sample: float = 0.0) -> Array:
    """Standard deviation of the trials' shift in time at each sample, in samples; 0 where none is told.

    Parameters
    ----------
    curves : (n_samples, n_trials) array
        Without lost samples, two trials or more.
    u_sample : float
        Standard deviation of the noise of one sample.

    Returns
    -------
    (n_samples,) array
        Not decreasing.

    Examples
    --------
    >>> t = np.arange(400.0)[:, None]
    >>> s = time_scatter(np.tanh((t - 200 - np.array([-2.0, 0.0, 2.0])) / 20))
    >>> float(s[0]), round(float(s[-1]), 1)
    (0.0, 2.0)
    """
    n_samples, n = curves.shape
    mean = curves.mean(axis=1)
    slope = np.gradient(mean)
    fastest = float(np.abs(slope).max())
    deviation = curves - mean[:, None]
    of_slope = float(np.square(np.gradient(deviation, axis=0)).sum()) / (n * (n - 1))
    if not float(slope @ slope) > IS_MOTION * of_slope:
        return np.zeros(n_samples)
    way = float(np.ptp(mean)) / fastest
    half = int(np.clip(round(WINDOW * way), 2, max(n_samples // 4, 2)))
    weight = np.hanning(2 * half + 3)[1:-1]
    weight /= weight.sum()

    def near(values: Array) -> Array:
        return np.asarray(convolve1d(values, weight, axis=0, mode="constant"))

    common = near(slope[:, None] * deviation)
    power = near(slope**2)
    moving = power > max((CLEAR * u_sample / half) ** 2, (MOVES**2) * float(power.max()))
    shift = common / np.where(power > 0, power, np.inf)[:, None]
    s = np.sqrt(np.square(shift - shift.mean(axis=1, keepdims=True)).sum(axis=1) / (n - 1))
    explained = np.square(common).sum(axis=1) > EXPLAINED * power * near(np.square(deviation).sum(axis=1))
    told = np.flatnonzero(moving & explained & (s < LONGEST * way))
    if not told.size:
        return np.zeros(n_samples)
    grown = np.sqrt(isotonic_regression(s[told] ** 2, weights=power[told]).x)
    return np.concatenate([np.zeros(told[0]), np.repeat(grown, np.diff(np.append(told, n_samples)))])


def reach_in_time(mean: Array, scatter: Array, n: int) -> Array:
    """How far a mean curve may lie from itself when shifted by as much as its trials may be, (n_samples,).

    Parameters
    ----------
    mean : (n_samples,) array
    scatter : (n_samples,) array
        As of `time_scatter`.
    n : int
        Trials.
    """
    factor = float(stdtrit(n - 1, 0.5 + TIME_CONFIDENCE / 2)) * np.sqrt(1 + 1 / n)
    # rounding keeps the number of different reaches small
    rounded = np.round(scatter / ROUND_SAMPLES) * ROUND_SAMPLES
    reach = np.minimum(np.round(factor * rounded), mean.size).astype(int)
    upper, lower = mean.copy(), -mean
    edges = np.flatnonzero(np.diff(reach)) + 1
    for first, last in zip(np.r_[0, edges], np.r_[edges, mean.size], strict=True):
        by = int(reach[first])
        if by == 0:
            continue
        there = slice(max(0, first - by), min(mean.size, last + by))
        for most, sign in ((upper, 1.0), (lower, -1.0)):
            part = np.full(there.stop - there.start, -np.inf)
            part[first - there.start : last - there.start] = sign * mean[first:last]
            shifted = maximum_filter1d(part, 2 * by + 1, mode="constant", cval=-np.inf)
            np.maximum(most[there], shifted, out=most[there])
    return np.asarray(np.maximum(upper - mean, lower + mean))
