"""How far a trial may lie off because its force is not known better: soft strokes amplify the smallest error.

Conventions: over the range, root mean square over a stretch of time; gain and level of the force are moved together
by three standard uncertainties, up and down, and by 0.3 % of the force at least, which is what a bench scatters from
blow to blow. Infinite where the model cannot be run.
"""

from __future__ import annotations

import math

import numpy as np

from model.errors import ModelError
from validation.conventions import ENCODER_BODIES, Array
from validation.measurement.trial import MeasuredTrial
from validation.prediction.model_under_test import ModelUnderTest

FORCE_MAY = 3.0  # standard uncertainties
SCATTERS = 0.003  # of the force, one standard deviation


def force_reach(tested: ModelUnderTest, m: MeasuredTrial, start_s: float, end_s: float) -> float:
    """Largest change of any encoder's prediction over its range, root mean square from start to end.

    One number for all bodies, which move each other: where one may go either way, none is told apart.
    """
    force = m.force
    inside = (m.time_s >= max(force.time_s[0], start_s)) & (m.time_s <= min(force.time_s[-1], end_s))
    rest = tested.load(force.preload_n).rest
    gain, level = FORCE_MAY * max(force.channel.gain_relative_u, SCATTERS), FORCE_MAY * force.u_level_n

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
        return float(np.max(np.max(moved, axis=0) / extent)) if np.all(extent > 0) else math.inf

    inputs = (tested.identity, force.time_s, force.force_n, force.preload_n, gain, level, m.time_s[inside])
    return float(tested.store.value("force reach", inputs, run))
