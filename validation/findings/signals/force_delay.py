"""Delay of the force channel: the force against the key's acceleration, both of which jump when the key meets its bed.

Conventions: s, positive when the force comes late after the declared delay was taken off. The motor's own inertia
makes force and acceleration rise together, whatever the friction; both are filtered alike, 30 to 400 Hz, and the lag
of their best correlation is compared with the lag in the prediction, where motion follows the same force by the laws
alone. Detectable from 0.5 ms where the correlation is above 0.85 (forte), from 1.2 ms above 0.5; silent below. The
median of the trials counts; one trial of its own is named when it is as far from the others. Positive lags are also
made by a clock that differs between the channels: the two cannot be told apart.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from validation.conventions import KEY, Array
from validation.findings.finding import SessionFinding
from validation.measurement.trial import MeasuredTrial
from validation.prediction.trial_prediction import PredictedAngles

BAND_HZ = (30.0, 400.0)
SMOOTH_S = 2.2e-3
LONGEST_S = 8e-3
CLEAR, CLEAR_S = 0.85, 0.5e-3
VISIBLE, VISIBLE_S = 0.5, 1.2e-3


def force_lag(m: MeasuredTrial, p: PredictedAngles) -> tuple[float, float]:
    """Lag of the force behind the key's acceleration beyond the prediction's, s, and its limit; NaN if unclear."""
    step = float(np.median(np.diff(m.time_s)))
    force = np.interp(m.time_s, m.force.time_s, m.force.force_n)
    expected = p.change_rad("key")
    known = np.isfinite(p.angle_rad[:, KEY])
    if 1 / step < 3 * BAND_HZ[1] or known.sum() < round(0.1 / step):
        return float("nan"), float("nan")
    lag, clear = _lag(force[known], m.change_rad[known, 0], step)
    lag_model, clear_model = _lag(force[known], expected[known], step)
    if min(clear, clear_model) < VISIBLE:
        return float("nan"), float("nan")
    limit = CLEAR_S if clear > CLEAR else VISIBLE_S
    # both the lag itself and what the prediction does not have must be large: the smaller one is safe to state
    apart = lag - lag_model
    safe = min(lag, apart, key=abs) if lag * apart > 0 else 0.0
    return float(safe), limit


def _lag(force: Array, key_rad: Array, step: float) -> tuple[float, float]:
    """Lag of the best correlation and that correlation."""
    a, f = band_passed(second_derivative(key_rad, step), step), band_passed(force, step)
    reach = round(LONGEST_S / step)
    inner = slice(2 * reach, a.size - 2 * reach)
    a0 = a[inner] - a[inner].mean()
    near = f[reach : f.size - reach] - f[reach : f.size - reach].mean()
    # a0 has no mean, so the mean of each shifted piece need not be taken off; its square sum comes from running sums
    running, squares = (np.concatenate([[0.0], np.cumsum(x)]) for x in (near, near**2))
    total, power = (x[a0.size :] - x[: -a0.size] for x in (running, squares))
    size = np.sqrt(np.maximum(power - total**2 / a0.size, 0.0) * (a0 @ a0))
    c = np.divide(np.correlate(near, a0, "valid"), size, out=np.zeros(size.size), where=size > 0)
    best = int(np.argmax(c))
    part = 0.0
    if 0 < best < c.size - 1:
        bend = c[best - 1] - 2 * c[best] + c[best + 1]
        part = 0.5 * float(c[best - 1] - c[best + 1]) / float(bend) if bend < 0 else 0.0
    return (best - c.size // 2 + part) * step, float(c[best])


def second_derivative(values: Array, step: float) -> Array:
    """Second derivative of the cubics fitted over `SMOOTH_S` around each sample (Savitzky and Golay 1964)."""
    half = max(round(SMOOTH_S / step / 2), 2)
    weights = 2.0 * np.linalg.pinv(np.vander(np.arange(-half, half + 1.0), 4, increasing=True))[2] / step**2
    return np.convolve(_extended(values, half), weights[::-1], "valid")


def band_passed(values: Array, step: float) -> Array:
    """Values within `BAND_HZ`: Butterworth's second order there and back, so that nothing is delayed.

    By the transform: ``scipy.signal`` takes half a second to import.
    """
    pad = min(round(2.0 / BAND_HZ[0] / step), values.size - 1)
    whole = _extended(values, pad)
    tangent = np.tan(np.pi * np.fft.rfftfreq(whole.size)[1:])
    low, high = np.tan(np.pi * step * np.array(BAND_HZ))
    apart = (tangent**2 - low * high) / (tangent * (high - low))
    gain = np.concatenate([[0.0], 1.0 / (1.0 + apart**4)])
    return np.asarray(np.fft.irfft(gain * np.fft.rfft(whole), whole.size)[pad : pad + values.size])


def _extended(values: Array, by: int) -> Array:
    """Values with ``by`` more at either end, turned about the first and the last."""
    return np.pad(values, by, mode="reflect", reflect_type="odd")


def force_delay(lags: Mapping[int, tuple[float, float]]) -> list[SessionFinding]:
    """A delay of the force in all trials, or in one trial alone; ``lags`` are those of `force_lag` by trial."""
    known = {n: v for n, v in lags.items() if np.isfinite(v[0])}
    if not known or len(known) < (len(lags) + 1) // 2:
        return []
    lag = float(np.median([v[0] for v in known.values()]))
    limit = float(np.median([v[1] for v in known.values()]))
    if abs(lag) > limit:
        return [_finding(float("nan"), "in all trials ", lag, limit)]
    return [
        _finding(float(n), f"trial {n}: ", v[0], v[1]) for n, v in known.items() if abs(v[0]) > v[1] < abs(v[0] - lag)
    ]


def _finding(trial: float, where: str, lag: float, limit: float) -> SessionFinding:
    side = "late" if lag > 0 else "early"
    text = (
        f"{where}the force comes {1e3 * abs(lag):.1f} ms {side} against the key's acceleration (limit "
        f"{1e3 * limit:.1f} ms): "
        "a delay of filter, amplifier or converter is not declared, or the channels' clocks differ; measure the delay"
    )
    return SessionFinding("force delay", trial, "force", lag, limit, text)
