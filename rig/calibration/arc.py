"""The scale of an encoder over the arc it turns: readings at reference angles, and the correction that follows.

A scale off its centre by e reads e sin(angle + phase) / radius too much; over the few degrees of an action that is a
factor, which no certificate of the scale knows. The references are an autocollimator's, or gauge blocks over a lever.
The encoder counts through all of them in one acquisition: a stopped counter would lose its zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.arrays import as_numbers
from rig.backend import Backend
from rig.calibration.line_fit import fit_line
from rig.calibration.rig_text import changed
from rig.configuration.channels import BODIES
from rig.configuration.rig_file import Rig, RigConfig, parse_rig
from rig.errors import RigInputError

HELD_S = 0.8
"""How long the body rests at a reference angle at least."""
STILL_COUNTS = 3
APART = 0.3
"""Share of the smallest step by which two angles must differ to be two."""
LONGEST_S = 1800.0
READ_TIMEOUT_S = 5.0
LARGEST_CORRECTION = 0.1
CONTRADICTS = 3.0


@dataclass(frozen=True)
class Arc:
    """True angle over reading, its standard uncertainty, and the largest distance of a reading from the line, rad."""

    gain: float
    u_gain: float
    worst_rad: float
    readings_rad: tuple[float, ...]
    references_rad: tuple[float, ...]


def there_and_back(angles_rad: ArrayLike) -> tuple[float, ...]:
    """Return the reference angles up and down again.

    Raises
    ------
    RigInputError
        Fewer than three angles, or not rising.
    """
    up = tuple(as_numbers(angles_rad, "reference angles", 1).tolist())
    if len(up) < 3 or list(up) != sorted(set(up)) or not np.all(np.isfinite(up)):
        raise RigInputError(f"reference angles {list(up)} rad: allowed from three, each once, rising")
    return up + up[-2::-1]


def read_plateaus(backend: Backend, config: RigConfig, body: str, references: Sequence[float]) -> list[float]:
    """Return the mean readings, rad, at as many rests as there are references, in the order they came.

    Raises
    ------
    RigInputError
        Fewer rests within half an hour.
    HardwareFault
        As when recording.
    """
    index = BODIES.index(body)
    encoder = config.encoders[index]
    per_count = encoder.sign * 2 * np.pi / encoder.counts_per_revolution
    apart = APART * float(np.min(np.abs(np.diff(references)))) / abs(per_count)
    timing = backend.configure(config.model_copy(update={"camera": None, "watchdog": None}), None)
    rate = timing.sample_rate_hz
    size = max(int(0.1 * rate), 1)
    held = int(HELD_S * rate)
    recent: NDArray[np.int64] = np.empty(0, dtype=np.int64)
    found: list[float] = []
    try:
        backend.arm(enable_drive=False)
        backend.start()
        for _ in range(int(LONGEST_S * rate) // size):
            count = backend.read_block(size, READ_TIMEOUT_S).encoder_count[:, index]
            recent = np.concatenate((recent, count))[-held:]
            still = recent.size == held and np.ptp(recent) <= STILL_COUNTS
            if still and (not found or abs(float(recent.mean()) - found[-1]) > apart):
                found.append(float(recent.mean()))
                if len(found) == len(references):
                    break
    finally:
        backend.safe_stop()
    if len(found) < len(references):
        raise RigInputError(
            f"{encoder.counter}: {len(found)} rests of {HELD_S:g} s seen, expected {len(references)}; hold each angle "
            "longer, and go up and down again"
        )
    return [value * per_count for value in found]


def fit_arc(references: Sequence[float], readings: Sequence[float], u_angle_rad: float, where: str) -> Arc:
    """Fit readings over references; up and down together, so that play of the references is in the uncertainty.

    Raises
    ------
    RigInputError
        Readings that do not follow, or a correction beyond 10 %.
    """
    x = np.asarray(references, dtype=float)
    fit = fit_line(x, readings, where)
    gain = 1.0 / fit.slope
    if abs(gain - 1.0) > LARGEST_CORRECTION:
        raise RigInputError(
            f"{where}: reads {fit.slope:.4f} of the reference angles, allowed 1 within {LARGEST_CORRECTION:.0%}; look "
            "at counts_per_revolution, the sign, and the sense of the angles"
        )
    spread = float(np.sqrt(np.sum((x - x.mean()) ** 2)))
    u = float(np.hypot(fit.u_slope, u_angle_rad / spread)) * gain**2
    return Arc(gain, u, fit.worst, tuple(float(r) for r in readings), tuple(x.tolist()))


def with_what_was_known(rig: Rig, body: str, arc: Arc) -> tuple[float, float]:
    """Return correction and uncertainty from the readings and the rig file together.

    The mean weighted by uncertainty, so that coarse references spoil no scale that is known better; readings that
    contradict the rig file by three standard uncertainties replace it.
    """
    encoder = rig.config.encoders[BODIES.index(body)]
    known, u_known = encoder.arc_gain, encoder.u_eccentricity_rad
    if abs(arc.gain - known) > CONTRADICTS * np.hypot(arc.u_gain, u_known):
        return arc.gain, arc.u_gain
    if u_known == 0.0 or arc.u_gain == 0.0:
        return (known, u_known) if u_known == 0.0 else (arc.gain, arc.u_gain)
    weights = np.array([arc.u_gain, u_known]) ** -2.0
    return float(weights @ [arc.gain, known] / weights.sum()), float(weights.sum() ** -0.5)


def corrected_rig(rig: Rig, body: str, arc: Arc) -> str:
    """Return the rig file's text with the correction of one encoder and its uncertainty."""
    gain, u_gain = with_what_was_known(rig, body, arc)
    values = {"arc_gain": float(f"{gain:.9g}"), "u_eccentricity_rad": float(f"{u_gain:.3g}")}
    text = changed(rig.text, "encoders", values, named=body)
    parse_rig(text, f"{rig.source} as calibrated")
    return text
