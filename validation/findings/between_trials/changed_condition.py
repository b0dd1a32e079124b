"""A condition that changed in mid-session: the residuals before one trial are not those after it.

Conventions: residuals as in `residuals`; for each place between two trials, the distance of the two means over the
scatter within both parts, in its standard deviation. Named from seven such deviations and 0.5 % of the range, with six
trials or more and two on each side, and only beyond what the scatter of the blows may do to the means of both parts
(`force_reach`). What changed cannot be told: bench, force channel and action look alike here.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from validation.conventions import Array
from validation.findings.between_trials.force_reach import force_reach
from validation.findings.between_trials.residuals import Residuals
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest

FEWEST_TRIALS = 6
FEWEST_IN_PART = 2
DEVIATIONS = 7.0
LEAST = 0.005  # of the range


def changed_condition(
    tested: ModelUnderTest, trials: Mapping[int, MeasuredTrial], residuals: Residuals
) -> list[SessionFinding]:
    """The place at which the residuals change, if there is one."""
    n = len(residuals.numbers)
    if n < FEWEST_TRIALS or residuals.numbers != tuple(sorted(residuals.numbers)):
        return []
    best = (0.0, 0.0, 0, "")
    for channel, curves in residuals.by_channel.items():
        for k in range(FEWEST_IN_PART, n - FEWEST_IN_PART + 1):
            deviations, apart = _step(curves, k)
            if apart > LEAST:
                best = max(best, (deviations, apart, k, channel))
    deviations, apart, k, channel = best
    if deviations < DEVIATIONS:
        return []
    last, first = residuals.numbers[k - 1], residuals.numbers[k]
    span = residuals.start_s, residuals.until_s
    of_means = np.sqrt(1 / k + 1 / (n - k))
    if apart <= of_means * max(force_reach(tested, trials[number], *span) for number in (last, first)):
        return []
    text = (
        f"something changed between trial {last} and trial {first}: the difference from the model in {channel} moves "
        f"by "
        f"{100 * apart:.1f} % of its range, {deviations:.0f} times what the trials scatter; action, motor or force "
        f"channel "
        "may have changed; validate both parts apart"
    )
    return [SessionFinding("changed condition", float(first), channel, deviations, DEVIATIONS, text)]


def _step(curves: Array, k: int) -> tuple[float, float]:
    """Distance of the means of both parts, in standard deviations and in ranges."""
    parts = curves[:, :k], curves[:, k:]
    apart = float(np.sqrt(np.mean((parts[0].mean(axis=1) - parts[1].mean(axis=1)) ** 2)))
    squares = sum(float(np.sum((part - part.mean(axis=1, keepdims=True)) ** 2)) for part in parts)
    n = curves.shape[1]
    within = float(np.sqrt(squares / curves.shape[0] / (n - 2)))
    return (apart / (within * np.sqrt(1 / k + 1 / (n - k))) if within > 0 else np.inf), apart
