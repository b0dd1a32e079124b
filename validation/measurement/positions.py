"""A stroke as this room sees it: displacements of key and hammer from rest, smoothed, with uncertainty and flags.

Conventions: displacements of the calibrated points, m, rising as the key is pressed and the hammer goes to the string.
What the sensor's reading at rest has drifted by is taken off the reading, and mains hum that the rest shows is fitted
there and subtracted. A sample is averaged over as many neighbours as its noise needs, at most some 10 ms, which happens
only where the ruler's curve is steep.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rig.mains_hum import fit_mains_hum
from rig.session import Session, TrialData
from rig.session.info import ChannelInfo
from rig.session.ruler import Position, ruler_curve
from validation.conventions import Array
from validation.errors import TrialError, ValidationInputError
from validation.measurement.measure_session import usable_trials
from validation.measurement.sample_fingerprints import sample_fingerprints

QUIET_S = 0.25
"""What is taken for rest before the stroke, at most; at least a period of the mains, over which hum has no mean."""
STILL_SIGMA = 5.0
NORMAL = 1.4826
"""Standard deviation of a normal distribution over its median departure."""
LEAST_SPAN = 1e-4
"""Of the ruler's readings: a departure by less is none, where neither noise nor rounding is stated."""
FEWEST = 16
"""Samples of rest, at least: twice as many as a level and its hum have numbers."""
NOISE_M = {"key": 2e-5, "hammer": 4e-5}
"""Noise down to which a sample is averaged with its neighbours."""
MOST_NEIGHBOURS = 40.0
MAINS = "mains_frequency_hz"
AS_FAR_AS_SEEN = ("complete", "incomplete")
"""Of a recording of positions that can be used."""


@dataclass(frozen=True, eq=False)
class Measured:
    """One sensor of one stroke."""

    position: Position  # as recorded, with flags and uncertainties
    value_m: Array  # (n,), displacement from rest, hum taken off, smoothed, m
    travel_m: float  # length of the ruler, m
    zero_reading: float  # what the reading at rest had drifted by
    # (n,), Standard uncertainty of level and hum that a rest shorter than `QUIET_S` leaves beyond those of a whole one,
    # m: one error for all samples. What a whole rest leaves is in the numbers of a band, which are learnt from such
    u_zero_m: Array

    def draw(self, random: np.random.Generator) -> Array:
        """Displacement by another calibration and rest that their uncertainties allow, m, zero at rest."""
        curve = ruler_curve(self.position.ruler)
        order = np.argsort(curve.height)
        at = curve.height[order]
        away = (curve.drawn(random, curve.places) - curve.height)[order]
        zero = random.spawn(1)[0].standard_normal() * self.u_zero_m
        return np.asarray(self.value_m + np.interp(self.value_m, at, away - away[0]) + zero)


@dataclass(frozen=True, eq=False)
class Stroke:
    """A usable stroke: sample times (n,), s from the trial's first sample, key and hammer."""

    number: int
    condition: str
    source: str
    time_s: Array
    key: Measured
    hammer: Measured
    samples: tuple[str, ...] = ()

    @property
    def interval_s(self) -> float:
        """Between samples, s."""
        return float(self.time_s[1] - self.time_s[0])


def measure_positions(session: Session) -> tuple[tuple[Stroke, ...], dict[int, str]]:
    """Usable strokes of a session, and by number the reason for each trial that is not.

    A trial whose recording ends within it is used as far as it goes: what the key has not done yet moves nothing. One
    whose recording begins within it has no rest and is refused.

    Raises
    ------
    ValidationInputError
        No trial is usable; the message has the first reason.
    """
    strokes, refused = usable_trials(session, lambda _, data: measure_stroke(data), AS_FAR_AS_SEEN)
    if not strokes:
        number, reason = next(iter(refused.items()), (0, "it has no trials"))
        raise ValidationInputError(f"{session.path}: no usable stroke; trial {number}: {reason}")
    return tuple(strokes), refused


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
    source = f"{float(origin['source_start_s']):.1f} s of the recording" if "source_start_s" in origin else ""
    if data.status != "complete":
        source = f"{source} ({data.reason})".strip()
    return Stroke(
        data.number, data.condition, source, data.time_s, found["key"], found["hammer"], sample_fingerprints(data)
    )


def _measure(data: TrialData, name: str, body: str) -> Measured:
    k = [channel.name for channel in data.channels].index(name)
    info, reading = data.channels[k], data.channel_values
    assert info.ruler is not None and reading is not None
    mains_hz = float(data.provenance.get(MAINS, "60"))
    quiet, needed = _rest(data, reading[:, k], info, 1.0 / mains_hz), round(data.sample_rate_hz / mains_hz)
    if quiet < max(needed, FEWEST):
        raise TrialError(
            f"{name}: found {1e3 * quiet / data.sample_rate_hz:.0f} ms at rest, one period of the mains before the "
            f"stroke; needed {1e3 * max(needed, FEWEST) / data.sample_rate_hz:.0f}, for in less than a period hum has "
            "a level of its own; the stroke is left out"
        )
    at_rest = np.arange(data.time_s.size) < quiet
    _, hum, _, _, u_reading = fit_mains_hum(data.time_s, reading[:, k], at_rest, np.array([mains_hz]))
    lacking = max(1.0 - quiet / (QUIET_S * data.sample_rate_hz), 0.0)
    zero = float(np.median((reading[:, k] - hum)[:quiet])) - float(info.ruler.reading[0])
    values = reading.copy()
    values[:, k] -= hum
    position = replace(data, channel_values=values).position(name, zero)
    value = smoothed(position.displacement_m, position.u_noise_m, NOISE_M[body])
    value = value - float(np.median(value[:quiet]))
    slope = np.abs(ruler_curve(info.ruler, name).slope(values[:, k] - zero))
    return Measured(position, value, position.travel_m, zero, np.sqrt(lacking) * u_reading * slope)


def _rest(data: TrialData, reading: Array, info: ChannelInfo, period_s: float) -> int:
    """Number of samples at rest with which a trial begins.

    Rest ends a period of the mains before the trigger, or before the mean over a period, which holds no hum, leaves
    that of the first period for good by more than its noise and the ruler explain.
    """
    assert info.ruler is not None
    time_s, step = data.time_s, 1.0 / data.sample_rate_hz
    end = int(np.count_nonzero(time_s < data.blow_start_s))
    summed = np.concatenate([[0.0], np.cumsum(0.5 * step * (reading[1:] + reading[:-1]))])
    at = time_s[:end][time_s[:end] >= period_s]
    if not at.size:
        return 0
    mean = (np.interp(at, time_s, summed) - np.interp(at - period_s, time_s, summed)) / period_s
    bend = np.abs(np.diff(reading[:end], 2))  # of white noise six times its variance, of hum and drift next to nothing
    noise = max(NORMAL * float(np.median(bend)) / np.sqrt(6.0), info.u_noise) if bend.size else info.u_noise
    unsure = max(info.ruler.u_reading, LEAST_SPAN * float(np.ptp(info.ruler.reading)))
    back = np.abs(mean - mean[0]) <= unsure + STILL_SIGMA * noise * np.sqrt(2.0 * step / period_s)
    return int(np.count_nonzero(time_s < min(float(at[back][-1]) - period_s, QUIET_S)))


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
