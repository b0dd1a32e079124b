"""A trial whose residual is not the others': the model, which knows each trial's force, finds it odd.

Conventions: residuals as in `residuals`, over the channel's range. A trial is named when its residual is five times as
large as the others' usually are, lies four times as far from them as is usual and a hundredth of the range, and neither
gain nor level of the force explains it within three standard uncertainties (soft strokes amplify both). Not detectable
with fewer than four trials.
"""

from __future__ import annotations

import numpy as np

from model.errors import ModelError
from validation.conventions import ENCODER_BODIES, Array
from validation.findings.between_trials.residuals import Residuals
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest
from validation.statistics.repeatability import FEWEST_TO_STAND_OUT, STANDS_OUT, distance_ratios

LARGER = 5.0
FAR = 0.01  # of the channel's range
FORCE_MAY = 3.0  # standard uncertainties
FORCE_LEAVES = 0.5  # of the squared difference


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
            if far > FAR and ratio[j] > STANDS_OUT and rms[j] > LARGER * usual > 0:
                worst[number] = max(worst.get(number, (0.0, "")), (float(rms[j] / usual), channel))
    out = []
    for number, (times, channel) in worst.items():
        if _explained_by_force(tested, trials[number], residuals.until_s):
            continue
        text = (
            f"trial {number}: the model, driven by its force, is {times:.0f} times as far from it in {channel} as "
            f"from the "
            "other trials, until the release: its force or an encoder is faulty for some time, or its blow was "
            "disturbed; "
            "look at this trial's residual"
        )
        out.append(SessionFinding("outlying residual", number, channel, times, LARGER, text))
    return out


def _explained_by_force(tested: ModelUnderTest, m: MeasuredTrial, until_s: float) -> bool:
    """Whether gain and level of the force, within their uncertainty, make most of this trial's residual."""
    force = m.force
    inside = (m.time_s >= force.time_s[0]) & (m.time_s <= min(force.time_s[-1], until_s))

    def residual(gain: float, level_n: float) -> Array:
        rest = tested.load(force.preload_n).rest
        found = tested.simulate(
            tested.action,
            force.time_s,
            gain * force.force_n + level_n,
            tolerance=tested.tolerance,
            output_time_s=m.time_s[inside],
            initial=rest,
        )
        change = np.asarray(found.angle_rad, dtype=float) - np.asarray(rest.angle_rad, dtype=float)
        return np.asarray(change[:, ENCODER_BODIES] - m.change_rad[inside]).ravel()

    try:
        start = residual(1.0, 0.0)
        # in both senses: a bistable stroke answers to one of them only
        moved = [
            residual(1 + sign * FORCE_MAY * force.channel.gain_relative_u, sign * FORCE_MAY * force.u_level_n)
            for sign in (-1.0, 1.0)
        ]
    except ModelError:
        return False
    return any(float(r @ r) < FORCE_LEAVES * float(start @ start) for r in moved)
