"""A trial whose residual is not the others': the model, which knows each trial's force, finds it odd.

Conventions: residuals as in `residuals`, over the channel's range. A trial is named when its residual is five times as
large as the others' usually are, lies four times as far from them as is usual and a hundredth of the range, and
further than an error of its force may move it (`force_reach`; soft strokes amplify it). Not detectable with fewer than
four trials.
"""

from __future__ import annotations

import numpy as np

from validation.findings.between_trials.force_reach import force_reach
from validation.findings.between_trials.residuals import Residuals
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.statistics.repeatability import FEWEST_TO_STAND_OUT, STANDS_OUT, distance_ratios

LARGER = 5.0
FAR = 0.01  # of the channel's range


def outlying_residuals(
    tested: ModelUnderTest, trials: dict[int, MeasuredTrial], residuals: Residuals
) -> list[SessionFinding]:
    """One finding per trial whose residual stands out in any channel."""
    if len(residuals.numbers) < FEWEST_TO_STAND_OUT:
        return []
    worst: dict[int, tuple[float, str]] = {}
    for channel, curves in residuals.by_channel.items():
        rms = np.sqrt(np.mean(curves**2, axis=0))
        ratio = distance_ratios(curves)
        for j, number in enumerate(residuals.numbers):
            others = np.delete(curves, j, axis=1)
            usual = float(np.median(np.delete(rms, j)))
            far = float(np.sqrt(np.mean((curves[:, j] - np.median(others, axis=1)) ** 2)))
            odd = far > FAR and ratio[j] > STANDS_OUT and rms[j] > LARGER * usual > 0
            if odd and far > force_reach(tested, trials[number], residuals.start_s, residuals.until_s):
                worst[number] = max(worst.get(number, (0.0, "")), (float(rms[j] / usual), channel))
    out = []
    for number, (times, channel) in worst.items():
        text = (
            f"trial {number}: the model, driven by its force, is {times:.0f} times as far from it in {channel} as "
            "from the other trials, until the release: its force or an encoder is faulty for some time, or its blow "
            "was "
            "disturbed; look at this trial's residual"
        )
        out.append(SessionFinding("outlying residual", number, channel, times, LARGER, text))
    return out
