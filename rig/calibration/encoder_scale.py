"""Calibration of an encoder's scale over the arc that its body turns, against reference angles.

A scale off its centre by e reads e sin(angle + phase) / radius too much; over the few degrees of an action that is a
factor, which no certificate of the scale knows. It follows from readings at reference angles (an autocollimator's, or
gauge blocks over a lever). The encoder counts through all of them in one acquisition: a stopped counter would lose its
zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rig.arrays import as_numbers
from rig.backend import CALM_BLOCK_S, Backend, Block
from rig.calibration.line_fit import LARGEST_CORRECTION, fit_line
from rig.calibration.quiet_reading import read_quiet
from rig.configuration.rig_file import BODIES, EncoderConfig, Rig, RigConfig
from rig.configuration.rig_file_edit import rewrite_table
from rig.errors import RigInputError
from rig.session.force_correction import MOVED_COUNTS

HELD_S = 0.8  # at least, at a reference angle: 40 periods of 50 Hz
APART = 0.3  # of the smallest step, by which two angles must differ to be two: choice below a half
LONGEST_ARC_S = 1800.0  # half an hour for all angles by hand
CONTRADICTS = 3.0  # standard uncertainties between references and rig file, from which the references replace it


@dataclass(frozen=True)
class Arc:
    """True angle over reading, its standard uncertainty, and the largest distance of a reading from the line, rad."""

    gain: float
    u_gain: float
    worst_rad: float
    readings_rad: tuple[float, ...]
    references_rad: tuple[float, ...]


def order_up_and_down(angles_rad: ArrayLike) -> tuple[float, ...]:
    up = tuple(as_numbers(angles_rad, "reference angles", 1).tolist())
    if len(up) < 3 or list(up) != sorted(set(up)) or not np.all(np.isfinite(up)):
        raise RigInputError(f"reference angles {list(up)} rad: allowed from three, each once, rising")
    return up + up[-2::-1]


def read_plateaus(backend: Backend, config: RigConfig, body: str, references: Sequence[float]) -> list[float]:
    """Mean readings, rad, of an encoder at the successive rests of its ``body``, each 0.8 s or longer and unlike the
    one before, until there are as many as ``references``, the angles, rad, that the operator sets; refuse fewer."""
    index = BODIES.index(body)
    encoder = config.encoders[index]
    apart = APART * float(np.min(np.abs(np.diff(references)))) / abs(encoder.rad_per_count)
    recent: NDArray[np.int64] = np.empty(0, dtype=np.int64)
    found: list[float] = []

    def take(block: Block, rate_hz: float) -> bool:
        nonlocal recent
        held = int(HELD_S * rate_hz)
        recent = np.concatenate((recent, block.encoder_count[:, index]))[-held:]
        still = recent.size == held and np.ptp(recent) <= MOVED_COUNTS
        if still and (not found or abs(float(recent.mean()) - found[-1]) > apart):
            found.append(float(recent.mean()))
        return len(found) == len(references)

    read_quiet(backend, config, CALM_BLOCK_S, LONGEST_ARC_S, take)
    if len(found) < len(references):
        raise RigInputError(
            f"{encoder.counter}: {len(found)} rests of {HELD_S:g} s seen, expected {len(references)}; hold each angle "
            "longer, and go up and down again"
        )
    return [value * encoder.rad_per_count for value in found]


def fit_arc(references: Sequence[float], readings: Sequence[float], u_angle_rad: float, encoder: EncoderConfig) -> Arc:
    """Fit the factor (gain) from an encoder's ``readings`` to true angle, both rad, ``references`` in the same order;
    ``u_angle_rad``: standard uncertainty of a reference. Refuse a gain more than 10 % off 1.

    Readings that happen to scatter less than counts are rounded are known no better than a count / sqrt 12.
    """
    x = np.asarray(references, dtype=float)
    fit = fit_line(x, readings, encoder.counter)
    gain = 1.0 / fit.slope
    if abs(gain - 1.0) > LARGEST_CORRECTION:
        raise RigInputError(
            f"{encoder.counter}: reads {fit.slope:.4f} of the reference angles, allowed 1 within "
            f"{LARGEST_CORRECTION:.0%}; look at counts_per_revolution, the sign, and the sense of the angles"
        )
    spread = float(np.sqrt(np.sum((x - x.mean()) ** 2)))
    u_slope = max(fit.u_slope, abs(encoder.rad_per_count) / 12**0.5 / spread)
    # a reference is off alike on the way up and down
    pulls = [np.sum(x[x == value] - x.mean()) / spread**2 for value in np.unique(x)]
    u = float(np.hypot(u_slope, u_angle_rad * np.linalg.norm(pulls))) * gain**2
    return Arc(gain, u, fit.worst, tuple(float(r) for r in readings), tuple(x.tolist()))


def combine_with_rig_file(rig: Rig, body: str, arc: Arc) -> tuple[float, float]:
    """Return the gain (true angle over reading) of the encoder on ``body`` and its standard uncertainty: the weighted
    mean of ``arc`` and the rig file, or ``arc`` alone where the rig file states none or contradicts it.

    Weighted by uncertainty, coarse references spoil no scale that is known better; a contradiction is a difference of
    three standard uncertainties.
    """
    encoder = rig.config.encoders[BODIES.index(body)]
    known, u_known = encoder.arc_gain, encoder.u_eccentricity_rad
    if abs(arc.gain - known) > CONTRADICTS * np.hypot(arc.u_gain, u_known):
        return arc.gain, arc.u_gain
    if (known, u_known) == (1.0, 0.0):  # nothing was stated
        return arc.gain, arc.u_gain
    if u_known == 0.0 or arc.u_gain == 0.0:
        return (known, u_known) if u_known == 0.0 else (arc.gain, arc.u_gain)
    weights = np.array([arc.u_gain, u_known]) ** -2.0
    return float(weights @ [arc.gain, known] / weights.sum()), float(weights.sum() ** -0.5)


def correct_rig_text(rig: Rig, body: str, arc: Arc) -> str:
    gain, u_gain = combine_with_rig_file(rig, body, arc)
    values = {"arc_gain": float(f"{gain:.9g}"), "u_eccentricity_rad": float(f"{u_gain:.3g}")}
    return rewrite_table(rig, "encoders", values, named=body)
