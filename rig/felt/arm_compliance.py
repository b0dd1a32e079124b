"""Compliance of arm and load cell: the way of the arm over force while it presses a block that does not give way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.configuration.rig_file import FeltConfig
from rig.errors import RigInputError
from rig.felt.readings import FEWEST_POINTS, read_press
from rig.session.trial_data import TrialData

ABOVE_N = 2.0  # on the block: below, surfaces that are not flat yet give way


@dataclass(frozen=True)
class Compliance:
    """Compliance with its standard uncertainty, m/N, and how far the readings are from a straight line, m."""

    m_per_n: float
    u_m_per_n: float
    crooked_m: float


def measure_compliance(trials: Sequence[TrialData], felt: FeltConfig) -> Compliance:
    """Return the compliance of arm and load cell, m/N, with standard uncertainty: mean slope of the tip's way over
    force, above 2 N, of trials that press a steel block; refuse a trial with too few such points and a slope not above
    0."""
    slopes, crooked = [], 0.0
    for trial in trials:
        read = read_press(trial, felt)
        hard = read.force_n > ABOVE_N
        if hard.sum() < 2 * FEWEST_POINTS:
            raise RigInputError(
                f"trial {trial.number}: {read.peak_n:.3g} N on the block, allowed well above {ABOVE_N:g} N"
            )
        line = np.polyfit(read.force_n[hard], read.moved_m[hard], 1)
        left = read.moved_m[hard] - np.polyval(line, read.force_n[hard])
        crooked = max(crooked, float(np.abs(left).max()))
        # a count read once too many at one end tilts the line; more readings do not make the scale finer
        slopes.append((float(line[0]), read.count_m / np.sqrt(12.0) / float(np.ptp(read.force_n[hard]))))
    values = np.array([slope for slope, _ in slopes])
    mean = float(values.mean())
    scatter = float(values.std(ddof=1)) if values.size > 1 else 0.0
    force, encoder = trials[0].force_info, next(e for e in trials[0].encoders if e.name == felt.encoder)
    relative = np.hypot(force.u_gain_relative, np.hypot(felt.u_radius_m / felt.radius_m, encoder.u_turn_relative))
    u = float(np.sqrt((mean * relative) ** 2 + scatter**2 / values.size + max(u for _, u in slopes) ** 2))
    if mean <= 0:
        raise RigInputError(f"block: compliance found {mean:.3g} m/N, allowed above 0; look at the encoder's mounting")
    return Compliance(mean, u, crooked)
