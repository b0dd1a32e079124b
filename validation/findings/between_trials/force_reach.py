"""How far a trial may lie off the others because its force differs by next to nothing: soft strokes amplify that.

Conventions: over the range, root mean square over a stretch of time. Gain and level of the force are moved together,
up and down, by three times what they differ from trial to trial: 0.3 % of scatter of a bench's blows and the fitted
offset; errors common to all trials do not count. Infinite where the model cannot be run.
"""

from __future__ import annotations

import math

import numpy as np

from model.errors import ModelError
from validation.conventions import ENCODER_BODIES, Array
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest

MAY = 3.0  # standard deviations
SCATTERS = 0.003  # of the force, one standard deviation
BETWEEN = 2.0  # a stroke that may go either way goes further than two predictions show


def force_reach(tested: ModelUnderTest, m: MeasuredTrial, start_s: float, end_s: float) -> float:
    """Largest change of any encoder's prediction over its range, root mean square from start to end.

    One number for all bodies, which move each other: where one may go either way, none is told apart.
    """
    force = m.force
    inside = (m.time_s >= max(force.time_s[0], start_s)) & (m.time_s <= min(force.time_s[-1], end_s))
    rest = tested.load(force.preload_n).rest
    gain, level = MAY * SCATTERS, MAY * force.hum.u_offset_n

    def angles(sense: float) -> Array:
        found = tested.simulate(
            tested.action,
            force.time_s,
            force.force_n + sense * (gain * (force.force_n - force.preload_n) + level),
            tolerance=tested.tolerance,
            output_time_s=m.time_s[inside],
            initial=rest,
        )
        return np.asarray(found.angle_rad, dtype=float)[:, ENCODER_BODIES]

    def run() -> float:
        try:
            middle = angles(0.0)
            moved = [np.sqrt(np.mean((angles(sense) - middle) ** 2, axis=0)) for sense in (-1.0, 1.0)]
        except ModelError:
            return math.inf
        extent = np.ptp(middle, axis=0)
        return BETWEEN * float(np.max(np.max(moved, axis=0) / extent)) if np.all(extent > 0) else math.inf

    inputs = (tested.identity, force.time_s, force.force_n, force.preload_n, gain, level, m.time_s[inside])
    return float(tested.store.value("force reach", inputs, run))
