"""A stroke as this room sees it: displacements of key and hammer from rest, smoothed, with uncertainty and flags.

Conventions: displacements of the calibrated points, m, rising as the key is pressed and the hammer goes to the string.
What the sensor's reading at rest has drifted by is taken off the reading, and mains hum that the rest shows is fitted
there and subtracted. A sample is averaged over as many neighbours as its noise needs, at most some 10 ms, which happens
only where the ruler's curve is steep.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigError
from rig.session import Session, TrialData
from rig.session.ruler import Position, ruler_curve
from validation.conventions import Array
from validation.errors import TrialError, ValidationInputError

QUIET_S = 0.25
"""What is taken for rest before the stroke; at least half of it must be there."""
HARMONICS = 3
NOISE_M = {"key": 2e-5, "hammer": 4e-5}
"""Noise down to which a sample is averaged with its neighbours."""
MOST_NEIGHBOURS = 40.0
MAINS = "mains_frequency_hz"


@dataclass(frozen=True, eq=False)
class Measured:
    """One sensor of one stroke.

    Attributes
    ----------
    position : Position
        As recorded, with flags and uncertainties.
    value_m : ndarray, shape (n,)
        Displacement from rest, hum taken off, smoothed, m.
    travel_m : float
        Length of the ruler, m.
    zero_reading : float
        What the reading at rest had drifted by.
    """

    position: Position
    value_m: Array
    travel_m: float
    zero_reading: float

    def draw(self, random: np.random.Generator) -> Array:
        """Displacement by another calibration that the ruler's uncertainty allows, m, zero at rest."""
        curve = ruler_curve(self.position.ruler)
        order = np.argsort(curve.displacement_m)
        at = curve.displacement_m[order]
        away = (curve.drawn(random, curve.reading) - curve.displacement_m)[order]
        return np.asarray(self.value_m + np.interp(self.value_m, at, away - away[0]))


@dataclass(frozen=True, eq=False)
class Stroke:
    """A usable stroke: sample times (n,), s from the trial's first sample, key and hammer."""

    number: int
    condition: str
    source: str
    time_s: Array
    key: Measured
    hammer: Measured

    @property
    def interval_s(self) -> float:
        """Between samples, s."""
        return float(self.time_s[1] - self.time_s[0])


@dataclass(frozen=True)
class MeasuredPositions:
    """Usable strokes of a session, and by number the reason for each trial that is not."""

    session: Session
    strokes: tuple[Stroke, ...]
    refused: dict[int, str]


def measure_positions(session: Session) -> MeasuredPositions:
    """Measure every usable trial.

    Raises
    ------
    ValidationInputError
        No trial is usable; the message has the first reason.
    """
    strokes, refused = [], {}
    for trial in session.trials:
        if trial.rejected is not None:
            refused[trial.number] = f"rejected: {trial.rejected}"
            continue
        try:
            data = trial.read()
            if data.status != "complete":
                raise TrialError(f"recorded with status {data.status!r}: {data.reason or 'no reason given'}")
            strokes.append(measure_stroke(data))
        except (RigError, TrialError) as error:
            refused[trial.number] = str(error)
    if not strokes:
        first = next(iter(refused.items()), (0, "it has no trials"))
        raise ValidationInputError(f"{session.path}: no usable stroke; trial {first[0]}: {first[1]}")
    return MeasuredPositions(session, tuple(strokes), refused)


def measure_stroke(data: TrialData) -> Stroke:
    """Measure key and hammer of one trial.

    Raises
    ------
    TrialError
        A sensor of key or hammer is missing or there are two, or the trial does not begin at rest.
    """
    found = {}
    for body in ("key", "hammer"):
        names = [c.name for c in data.channels if c.ruler is not None and c.ruler.body == body]
        if len(names) != 1:
            raise TrialError(f"{len(names)} position sensors of the {body}, allowed 1; found {data.position_names}")
        found[body] = _measure(data, names[0], body)
    origin = data.provenance
    source = f"{float(origin['source_start_s']):.1f} s" if "source_start_s" in origin else ""
    return Stroke(data.number, data.condition, source, data.time_s, found["key"], found["hammer"])


def _measure(data: TrialData, name: str, body: str) -> Measured:
    k = [channel.name for channel in data.channels].index(name)
    info, reading = data.channels[k], data.channel_values
    assert info.ruler is not None and reading is not None
    quiet = (data.time_s < min(QUIET_S, data.blow_start_s)) & (data.time_s <= QUIET_S)
    if data.time_s[quiet].size * (1.0 / data.sample_rate_hz) < QUIET_S / 2:
        raise TrialError(
            f"{name}: {1e3 * data.blow_start_s:.0f} ms of rest before the stroke, {500 * QUIET_S:.0f} needed"
        )
    hum = mains_hum(data.time_s, reading[:, k], quiet, float(data.provenance.get(MAINS, "60")))
    ruler_zero = float(info.ruler.reading[0])
    zero = float(np.median((reading[:, k] - hum)[quiet])) - ruler_zero
    values = reading.copy()
    values[:, k] -= hum
    position = replace(data, channel_values=values).position(name, zero)
    value = smoothed(position.displacement_m, position.u_noise_m, NOISE_M[body])
    value = value - float(np.median(value[quiet]))
    return Measured(position, value, position.travel_m, zero)


def mains_hum(time_s: Array, reading: Array, quiet: NDArray[np.bool_], mains_hz: float) -> Array:
    """Hum of a reading (n,): sinusoids of the mains and its harmonics, fitted where it is quiet."""

    def waves(t: Array) -> Array:
        turns = [2.0 * np.pi * mains_hz * k * t for k in range(1, HARMONICS + 1)]
        return np.column_stack([wave(turn) for turn in turns for wave in (np.sin, np.cos)])

    design = np.column_stack([np.ones(int(quiet.sum())), waves(time_s[quiet])])
    fitted = np.linalg.lstsq(design, reading[quiet], rcond=None)[0]
    return np.asarray(waves(time_s) @ fitted[1:])


def smoothed(value: Array, u_noise: Array, wanted: float) -> Array:
    """Averages over as many neighbours (Gaussian weights) as bring the noise to ``wanted``, one where it is there."""
    neighbours = np.clip((u_noise / wanted) ** 2, 1.0, MOST_NEIGHBOURS)
    width = neighbours / (2.0 * np.sqrt(np.pi))  # standard deviation, in samples, of Gaussian weights worth so many
    reach = int(np.ceil(3.0 * width.max()))
    out, padded = np.zeros(value.size), np.pad(value, reach, mode="edge")
    weight = np.zeros(value.size)
    for k in range(-reach, reach + 1):
        share = np.exp(-0.5 * (k / np.maximum(width, 0.05)) ** 2)
        out += share * padded[reach + k : reach + k + value.size]
        weight += share
    return out / weight
