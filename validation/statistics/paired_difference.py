"""Paired differences: is a difference between model and trials larger than what scatter and sensors can explain?

Conventions: columns are trials; difference = model − trial of the same trial, so that the scatter of the blows, which
both share through the force, cancels. Fewer than two trials give NaN.
Source: Student's t for the mean of n paired differences at each instant, with the encoder's or film's own standard
uncertainty added in quadrature (it is common to all trials at worst); instant by instant, and for the whole curve at
once with the critical value of `validation.statistics.simultaneous_band`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from validation.conventions import Array
from validation.statistics.simultaneous_band import FEWEST_FOR_BAND, simultaneous_band


@dataclass(frozen=True)
class PairedDifference:
    """Mean difference over trials and its 95 % uncertainty, at each instant (`u95`) and for all at once (`band95`).

    ``resolved_share`` and ``pointwise_share`` are the shares of time at which the mean exceeds the one or the other.
    """

    mean: Array
    u95: Array
    band95: Array
    rms: float
    resolved_share: float
    pointwise_share: float


def paired_difference(model: Array, trial: Array, u_sample: float, u_scale_relative: float = 0.0) -> PairedDifference:
    """Mean paired difference at each instant.

    Parameters
    ----------
    model, trial : (n_samples, n_trials) arrays
    u_sample : float
        Standard uncertainty of one measured sample.
    u_scale_relative : float
        Of the sensor's scale, the same in all trials: it grows with the angle.

    Returns
    -------
    PairedDifference
        ``rms`` is the root mean square of the mean difference over the window.
    """
    difference = np.asarray(model, dtype=float) - np.asarray(trial, dtype=float)
    n = difference.shape[1]
    nan = float("nan")
    if n < 2:
        nothing = np.full(difference.shape[0], nan)
        return PairedDifference(difference[:, 0] if n else nothing, nothing, nothing, nan, nan, nan)
    mean = difference.mean(axis=1)
    scatter = difference.std(axis=1, ddof=1) / np.sqrt(n)
    sensor = 1.96 * np.hypot(u_sample, u_scale_relative * np.abs(np.asarray(trial, dtype=float)).mean(axis=1))
    u95 = np.hypot(stdtrit(n - 1, 0.975) * scatter, sensor)
    band95 = np.hypot(simultaneous_band(difference, u_sample=u_sample).half_width, sensor)
    known = np.isfinite(mean)
    if not known.any():
        return PairedDifference(mean, u95, band95, nan, nan, nan)
    size = np.abs(mean[known])
    return PairedDifference(
        mean,
        u95,
        band95,
        float(np.sqrt(np.mean(size**2))),
        float(np.mean(size > band95[known])) if n >= FEWEST_FOR_BAND else nan,
        float(np.mean(size > u95[known])),
    )
