"""The loading curve of one press, with what its points share: compliance, radius, gain, preload, delay, first touch.

Each common error is carried through the whole evaluation: with it one standard uncertainty off the curve is computed
again, first touch included, and the difference is what the file states for each point.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.configuration.felt_setup import FeltConfig
from rig.felt.first_touch import first_touch
from rig.felt.readings import Readings, loading_speed, readings
from rig.session.trial_data import TrialData

PHASES = ("loading", "unloading")
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PressCurve:
    """One press.

    Attributes
    ----------
    displacement_m, force_n : (n,) compression since first touch and force of the felt, in the order measured
    loading : (n,) true for the first phase
    common : by name, (2, n) change of displacement and force if that error were one standard uncertainty
    speed_m_per_s, u_speed_m_per_s : rate of compression while loading, towards the peak, where the loop is read
    swing : by what share the speed near the peak, which is the one stated, differs from that of the whole way
    peak_n, deepest_m : largest force and compression
    """

    displacement_m: Array
    force_n: Array
    loading: NDArray[np.bool_]
    common: dict[str, Array]
    speed_m_per_s: float
    u_speed_m_per_s: float
    swing: float
    peak_n: float
    deepest_m: float

    def table(self) -> str:
        """Return the curve as ``calibrate-felt`` reads it, CSV."""
        names = ["displacement_m", "force_n", "phase"]
        names += [f"common_{name}_{unit}" for name in self.common for unit in ("m", "n")]
        shared = [row for moved in self.common.values() for row in moved]
        lines = [",".join(names)]
        for k, (x, f, first) in enumerate(zip(self.displacement_m, self.force_n, self.loading, strict=True)):
            cells = [f"{x:.9g}", f"{f:.9g}", PHASES[0] if first else PHASES[1]]
            lines.append(",".join([*cells, *(f"{row[k]:.4g}" for row in shared)]))
        return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class _Truth:
    """What the evaluation takes for true."""

    compliance: float
    length: float = 1.0
    gain: float = 1.0
    preload_n: float = 0.0
    delay_s: float = 0.0


def press_curve(trial: TrialData, felt: FeltConfig) -> PressCurve:
    """Evaluate a press.

    Parameters
    ----------
    trial : TrialData
    felt : FeltConfig
        ``[felt]`` of the rig file it was recorded with.

    Raises
    ------
    RigInputError
        The encoder did not turn, a phase is too short, or no first touch is found.
    """
    read, force = readings(trial, felt), trial.force_info
    scale = next(encoder for encoder in trial.encoders if encoder.name == felt.encoder)
    u_length = float(np.hypot(felt.u_radius_m / felt.radius_m, scale.u_turn_relative))
    known = _Truth(felt.compliance_m_per_n, preload_n=force.preload_n)
    x, f, u_rest = _compressed(read, known, force.preload_n)
    off = {
        "compliance": replace(known, compliance=known.compliance + felt.u_compliance_m_per_n),
        "length": replace(known, length=1.0 + u_length),
        "gain": replace(known, gain=1.0 + force.u_gain_relative),
        "preload": replace(known, preload_n=known.preload_n + force.u_preload_n),
        "delay": replace(known, delay_s=force.u_group_delay_s),
    }
    common = {}
    for name, other in off.items():
        moved, pressed, _ = _compressed(read, other, force.preload_n)
        common[name] = np.vstack((moved - x, pressed - f))
    # the divided line signal of the scale: its error comes back with each line; a line as long as the press bends most
    wave = 2 * np.pi * read.moved_m / float(np.ptp(read.moved_m))
    for name, shape in (("division_sin", np.sin(wave)), ("division_cos", np.cos(wave) - 1.0)):
        swept = np.sqrt(2.0) * scale.u_interpolation_rad * felt.radius_m * shape
        common[name] = np.vstack((swept, np.zeros(x.size)))
    common["first_touch"] = np.vstack((np.full(x.size, u_rest), np.zeros(x.size)))
    mean, speed = loading_speed(x, read.loading, read.samples, trial.sample_rate_hz)
    swing = speed / mean - 1.0
    # by the scale, by a count at its ends, and by what it changes on the way
    by_count = read.count_m / float(read.samples[read.loading].sum()) * trial.sample_rate_hz
    u_speed = float(np.sqrt((speed * u_length) ** 2 + by_count**2 + (speed * swing) ** 2))
    return PressCurve(x, f, read.loading, common, speed, u_speed, swing, read.peak_n, float(x.max()))


def _compressed(read: Readings, known: _Truth, stated_preload_n: float) -> tuple[Array, Array, float]:
    """Compression and force of the felt, and the standard uncertainty of the compression at rest."""
    force = (read.force_n - stated_preload_n + read.rate_n_per_s * known.delay_s) * known.gain + known.preload_n
    moved = read.moved_m * known.length - known.compliance * (force - known.preload_n)
    slope = np.abs(np.gradient(force[read.loading], moved[read.loading]))
    at = np.interp(moved, moved[read.loading], slope)
    u = np.hypot(read.u_force_n, at * read.count_m / np.sqrt(12.0)) / np.sqrt(read.samples)
    touch = first_touch(moved, force, read.loading, u, known.preload_n)
    return moved + touch.rest_m, force, touch.u_rest_m
