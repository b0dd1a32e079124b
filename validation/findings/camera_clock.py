"""The clock of a film against the DAQ clock, by the whippen that both film and encoder see."""

from __future__ import annotations

import numpy as np

from validation.conventions import WHIPPEN, Array
from validation.findings.finding import SessionFinding
from validation.measurement.mains_hum import correlation_inflation
from validation.measurement.trial import MeasuredTrial

CLOCK_S = 1e-4


def camera_clock(m: MeasuredTrial) -> list[SessionFinding]:
    """Film times against the DAQ clock, by the whippen that both film and encoder see."""
    film = m.film
    if film is None or film.whippen_rad is None:
        return []
    offset, u = clock_offset(film.time_s, film.whippen_rad, m.time_s, m.change_rad[:, WHIPPEN])
    limit = max(CLOCK_S, 3 * float(np.hypot(u, film.u_time_s)))
    if not abs(offset) > limit:
        return []
    side = "late" if offset > 0 else "early"
    text = (
        f"trial {m.number}: film: frame times are {1e3 * abs(offset):.2f} ms {side} against the whippen's encoder "
        f"(u {1e3 * u:.3f} ms, limit {1e3 * limit:.2f} ms); check trigger frame, exposure and delay of the camera"
    )
    return [SessionFinding("camera offset", m.number, "film", offset, limit, text)]


def clock_offset(film_s: Array, film_rad: Array, time_s: Array, angle_rad: Array) -> tuple[float, float]:
    """Delay of a film's clock against the encoder's, s, positive when frame times are late, and its uncertainty.

    Least squares of delay and zero by Gauss–Newton; the uncertainty takes neighbouring residuals for dependent.
    """
    speed = np.gradient(angle_rad, time_s)
    delay, u = 0.0, float("nan")
    for _ in range(20):
        at = film_s - delay
        known = np.isfinite(film_rad) & (at > time_s[0]) & (at < time_s[-1])
        if known.sum() < 10:
            return 0.0, float("nan")
        difference = film_rad[known] - np.interp(at[known], time_s, angle_rad)
        design = np.column_stack([np.ones(known.sum()), -np.interp(at[known], time_s, speed)])
        value, *_ = np.linalg.lstsq(design, difference, rcond=None)
        residual = difference - design @ value
        variance = float(residual @ residual) / max(known.sum() - 2, 1) * correlation_inflation(residual)
        u = float(np.sqrt(variance * np.linalg.pinv(design.T @ design)[1, 1]))
        delay += float(np.clip(value[1], -5e-3, 5e-3))
        if abs(value[1]) < 1e-9:
            break
    return delay, u
