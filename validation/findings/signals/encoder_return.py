"""Return of the encoders: at rest again after the stroke, each must read what it read before.

Conventions: rad, changes since rest; the last 50 ms of the record. An encoder that stands still elsewhere, while the
model or the two others are back, has lost or gained counts, or its body rests elsewhere: the two cannot be told apart.
Detectable from 3, 5 and 1.5 mrad.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from validation.conventions import ENCODER_CHANNELS
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial
from validation.prediction.trial_prediction import PredictedAngles

END_S = 0.05
STILL_RAD = 0.3e-3
RETURNS_RAD = (3e-3, 5e-3, 1.5e-3)  # key, whippen, hammer: friction lets a soft stroke rest up to half of it away


def end_of(m: MeasuredTrial) -> slice:
    """Samples of the last 50 ms."""
    return slice(int(np.searchsorted(m.time_s, m.time_s[-1] - END_S)), m.time_s.size)


def stands_still(m: MeasuredTrial) -> NDArray[np.bool_]:
    """Whether each encoder stands still at the end of the record."""
    return np.asarray(np.ptp(m.change_rad[end_of(m)], axis=0) < STILL_RAD)


def at_rest_again(m: MeasuredTrial) -> NDArray[np.bool_]:
    """Whether each encoder stands still where it began."""
    return stands_still(m) & (np.abs(m.change_rad[end_of(m)].mean(axis=0)) < np.array(RETURNS_RAD))


def encoder_return(m: MeasuredTrial, p: PredictedAngles) -> list[SessionFinding]:
    """Encoders that stand still elsewhere than where they began, though the stroke is over."""
    end = m.change_rad[end_of(m)].mean(axis=0)
    still, back = stands_still(m), at_rest_again(m)
    known = np.isfinite(p.angle_rad[:, 0])
    if not known.any():
        return []
    last = np.flatnonzero(known)[-1]
    model_back = all(
        abs(float(p.change_rad(name)[last])) < limit for name, limit in zip(ENCODER_CHANNELS, RETURNS_RAD, strict=True)
    )
    over = model_back or int(back.sum()) == 2
    out = []
    for i, name in enumerate(ENCODER_CHANNELS):
        if not over or not still[i] or back[i]:
            continue
        counts = end[i] / m.resolution_rad[i]
        text = (
            f"trial {m.number}: encoder {name}: at rest after the stroke it reads {1e3 * end[i]:+.2f} mrad against "
            f"before, "
            f"{counts:+.0f} counts (limit {1e3 * RETURNS_RAD[i]:g} mrad): counts were lost or gained, or the body "
            f"rests "
            "elsewhere; check signal levels and largest count rate of the reader"
        )
        out.append(SessionFinding("encoder return", m.number, name, float(end[i]), RETURNS_RAD[i], text))
    return out
