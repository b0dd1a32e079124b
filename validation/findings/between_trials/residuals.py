"""Residuals of all trials on one time base: model − trial from the start of the window to the first release.

After the release differences grow of themselves; before it a trial's residual is its own force and the model's error,
and the latter is common to all trials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from validation.conventions import ENCODER_CHANNELS, Array
from validation.events.session import SessionEvents
from validation.measurement.trial import MeasuredTrial
from validation.prediction.session import PredictedSession


@dataclass(frozen=True)
class Residuals:
    """Residuals over the range of the channel, by channel (n_samples, n_trials); numbers of the trials."""

    numbers: tuple[int, ...]
    by_channel: dict[str, Array]
    start_s: float
    until_s: float


def residuals_of(predicted: PredictedSession, events: SessionEvents, trials: Sequence[MeasuredTrial]) -> Residuals:
    """Residuals of some of the trials."""
    release = [events.trial[m.number]["key_release"] for m in trials]
    until = min((e.value for e in release if e.status != "absent"), default=events.window.end_s)
    by_channel: dict[str, Array] = {}
    if trials:
        time = trials[0].time_s
        base = time[(time >= events.window.start_s) & (time <= until)]
        for i, name in enumerate(ENCODER_CHANNELS):
            curves = []
            for m in trials:
                change = predicted.predictions[m.number].model.change_rad(name)
                curves.append(np.interp(base, m.time_s, change - m.change_rad[:, i], right=np.nan))
            extent = float(np.median([np.ptp(m.change_rad[:, i]) for m in trials]))
            values = np.column_stack(curves)
            values = values[np.isfinite(values).all(axis=1)]
            if extent > 0 and len(values) > 1:
                by_channel[name] = values / extent
    return Residuals(tuple(m.number for m in trials), by_channel, events.window.start_s, float(until))
