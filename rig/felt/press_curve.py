"""The loading curve of a press, and what each common error of one standard uncertainty does to it.

The points share compliance, radius, gain, preload, delay and first touch. Each of these errors is carried through the
whole evaluation, first touch included. The arm rests on the felt with a preload, so the zero of compression lies before
the rest: fitted together are the felt's cubic (eq. 2.5), its loop as a share of the cubic, and the way from first touch
to rest; the force at rest is the preload.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.configuration.rig_file import FeltConfig
from rig.errors import RigInputError
from rig.felt.readings import Readings, read_press
from rig.session.trial_data import TrialData

Array = NDArray[np.float64]


def measure_loading_speed(
    x_m: Array, loading: NDArray[np.bool_], samples: NDArray[np.int64], rate_hz: float
) -> tuple[float, float]:
    """Return the mean speed of the loading, m/s, and that of the last third of its way, by lines through compression
    ``x_m`` (n,), m, over time; ``loading`` (n,) marks these points, ``samples`` (n,): how many each is the mean of."""
    at = np.cumsum(samples[loading]) / rate_hz
    x = x_m[loading]
    last = x > x[-1] * 2.0 / 3.0
    return float(np.polyfit(at, x, 1)[0]), float(np.polyfit(at[last], x[last], 1)[0])


DEEPEST_REST = 0.5  # share of the way that the preload may have taken up: beyond it the start of the curve is guessed
PRELOAD_SHARE = 0.1  # of a reading's u, to which the curve meets the preload; its own error is common to all points


def fit_first_touch(
    moved_m: Array, force_n: Array, loading: NDArray[np.bool_], u_n: Array, preload_n: float
) -> tuple[float, float]:
    """Return the compression of a felt at rest under ``preload_n``, N, and its standard uncertainty, m, by a fit of the
    felt's curve and loop to ways since rest, m, and forces, N, (n,), ``loading`` or not; ``u_n`` (n,): of each force.
    """
    from scipy.optimize import least_squares  # start-up: 0.2 s that only the press of a felt needs

    span, top = float(moved_m.max()), float(force_n.max())
    sense = np.where(loading, 1.0, -1.0)
    u_preload = PRELOAD_SHARE * float(np.median(u_n))

    def residual(p: Array) -> Array:
        a, b, c, rest, share = p
        x = moved_m / span + rest
        at_rest = (((a * rest + b) * rest + c) * rest - preload_n / top) * top / u_preload
        fit = (((a * x + b) * x + c) * x) * (1.0 + share * sense)
        return np.append((fit - force_n / top) * top / u_n, at_rest)

    start = np.polyfit(moved_m / span, force_n / top, 3)
    slope = max(start[2], 4.0 * preload_n / top, 1e-3)  # so that the rest begins at a quarter of the way at most
    guess = np.array([start[0], start[1], slope, preload_n / top / slope, 0.0])
    fit = least_squares(
        residual,
        guess,
        bounds=([-np.inf, -np.inf, 0.0, 0.0, -0.5], [np.inf, np.inf, np.inf, DEEPEST_REST, 0.5]),
        x_scale="jac",
    )
    rest = float(fit.x[3])
    if not fit.success or not 0.0 <= rest < DEEPEST_REST - 1e-3:
        raise RigInputError(
            f"felt: first touch not found: at rest the felt would be compressed by {1e3 * rest * span:.3g} mm of "
            f"{1e3 * span:.3g} mm; look at force.preload_n, or lighten the preload"
        )
    freedom = max(moved_m.size + 1 - guess.size, 1)
    widened = max(2.0 * float(fit.cost) / freedom, 1.0)
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * widened
    return rest * span, float(np.sqrt(covariance[3, 3])) * span


PHASES = ("loading", "unloading")


@dataclass(frozen=True, eq=False)
class PressCurve:
    # displacement_m, force_n: (n,) compression since first touch and force of the felt, in the order measured
    displacement_m: Array
    force_n: Array
    loading: NDArray[np.bool_]  # (n,) true for the first phase
    # by name, (2, n) change of displacement and force if that error were one standard uncertainty
    common: dict[str, Array]
    # speed_m_per_s, u_speed_m_per_s: rate of compression while loading, towards the peak, where the loop is read
    speed_m_per_s: float
    u_speed_m_per_s: float
    swing: float  # by what share the speed near the peak, which is the one stated, differs from that of the whole way
    # peak_n, deepest_m: largest force and compression
    peak_n: float
    deepest_m: float

    def table(self) -> str:
        """Return the curve as CSV text for ``calibrate felt``, writing nothing: compression, m, force, N, phase, and
        for each common error its shift of both."""
        names = ["displacement_m", "force_n", "phase"]
        names += [f"common_{name}_{unit}" for name in self.common for unit in ("m", "n")]
        shared = [row for moved in self.common.values() for row in moved]
        lines = [",".join(names)]
        for k, (x, f, first) in enumerate(zip(self.displacement_m, self.force_n, self.loading, strict=True)):
            cells = [f"{x:.9g}", f"{f:.9g}", PHASES[0] if first else PHASES[1]]
            lines.append(",".join([*cells, *(f"{row[k]:.4g}" for row in shared)]))
        return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class _Assumed:
    """Constants that an evaluation assumes."""

    compliance: float
    length: float = 1.0
    gain: float = 1.0
    preload_n: float = 0.0
    delay_s: float = 0.0


def fit_press_curve(trial: TrialData, felt: FeltConfig) -> PressCurve:
    """Return the curve of a press, compression since first touch, m, over force, N, loading then unloading, with its
    speed and with the shift of all points by each common error of one standard uncertainty."""
    read, force = read_press(trial, felt), trial.force_info
    scale = next(encoder for encoder in trial.encoders if encoder.name == felt.encoder)
    u_length = float(np.hypot(felt.u_radius_m / felt.radius_m, scale.u_turn_relative))
    assumed = _Assumed(felt.compliance_m_per_n, preload_n=force.preload_n)
    x, f, u_rest = _compression_and_force(read, assumed, force.preload_n)
    off = {
        "compliance": replace(assumed, compliance=assumed.compliance + felt.u_compliance_m_per_n),
        "length": replace(assumed, length=1.0 + u_length),
        "gain": replace(assumed, gain=1.0 + force.u_gain_relative),
        "preload": replace(assumed, preload_n=assumed.preload_n + force.u_preload_n),
        "delay": replace(assumed, delay_s=force.u_group_delay_s),
    }
    common = {}
    for name, other in off.items():
        moved, pressed, _ = _compression_and_force(read, other, force.preload_n)
        common[name] = np.vstack((moved - x, pressed - f))
    # the divided line signal of the scale: its error comes back with each line; a line as long as the press bends most
    wave = 2 * np.pi * read.moved_m / float(np.ptp(read.moved_m))
    for name, shape in (("division_sin", np.sin(wave)), ("division_cos", np.cos(wave) - 1.0)):
        swept = np.sqrt(2.0) * scale.u_interpolation_rad * felt.radius_m * shape
        common[name] = np.vstack((swept, np.zeros(x.size)))
    common["first_touch"] = np.vstack((np.full(x.size, u_rest), np.zeros(x.size)))
    mean, speed = measure_loading_speed(x, read.loading, read.samples, trial.sample_rate_hz)
    swing = speed / mean - 1.0
    # by the scale, by a count at its ends, and by what it changes on the way
    by_count = read.count_m / float(read.samples[read.loading].sum()) * trial.sample_rate_hz
    u_speed = float(np.sqrt((speed * u_length) ** 2 + by_count**2 + (speed * swing) ** 2))
    return PressCurve(x, f, read.loading, common, speed, u_speed, swing, read.peak_n, float(x.max()))


def _compression_and_force(read: Readings, assumed: _Assumed, stated_preload_n: float) -> tuple[Array, Array, float]:
    """Return compression since first touch, m, and force, N, (n,) each, of a press ``read``, under the constants
    ``assumed``, and the standard uncertainty of the compression at rest, m; ``stated_preload_n``: the preload in
    ``read``."""
    force = (read.force_n - stated_preload_n + read.rate_n_per_s * assumed.delay_s) * assumed.gain + assumed.preload_n
    compression_m = read.moved_m * assumed.length - assumed.compliance * (force - assumed.preload_n)
    slope = np.abs(np.gradient(force[read.loading], compression_m[read.loading]))
    at = np.interp(compression_m, compression_m[read.loading], slope)
    u = np.hypot(read.u_force_n, at * read.count_m / np.sqrt(12.0)) / np.sqrt(read.samples)
    rest_m, u_rest_m = fit_first_touch(compression_m, force, read.loading, u, assumed.preload_n)
    return compression_m + rest_m, force, u_rest_m
