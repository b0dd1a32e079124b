"""A trial of position sensors: displacements of key and hammer from rest, smoothed, with uncertainty and flags.

Conventions: displacements of the calibrated points, m, rising as the key is pressed and the hammer goes to the string.
What the sensor's reading at rest has drifted by is taken off the reading, and mains hum that the rest shows is fitted
there and subtracted. A sample is averaged over as many neighbours as its noise needs, at most some 10 ms, which happens
only where the ruler's curve is steep. The trial's changes of angle are those of `validation.measurement.
position_sensors`: the key's by its calibration, for it drives the model, the hammer's as read.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rig.mains_hum import fit_mains_hum
from rig.session import TrialData
from rig.session.force_correction import Quiet
from rig.session.info import ChannelInfo
from rig.session.ruler import Position, ruler_curve
from validation.conventions import SIGMAS, Array
from validation.errors import TrialError
from validation.measurement.geometry import motion_of
from validation.measurement.position_sensors import (
    PRIOR_U,
    PositionSensors,
    SensorCalibration,
    reference_geometry,
    reference_turns,
)
from validation.measurement.sample_fingerprints import sample_fingerprints
from validation.measurement.trial import MeasuredTrial, make_absent_force

QUIET_S = 0.25
"""What is taken for rest before the stroke, at most; at least a period of the mains, over which hum has no mean."""
NORMAL = 1.4826
"""Standard deviation of a normal distribution over its median departure."""
LEAST_SPAN = 1e-4
"""Of the ruler's readings: a departure by less is none, where neither noise nor rounding is stated."""
FEWEST = 16
"""Samples of rest, at least: twice as many as a level and its hum have numbers."""
NOISE_M = {"key": 2e-5, "hammer": 4e-5}
"""Noise down to which a sample is averaged with its neighbours."""
MOST_NEIGHBOURS = 40.0  # averaged with a sample: noise falls to a sixth, and motion blurs by milliseconds
MAINS = "mains_frequency_hz"
AS_FAR_AS_SEEN = ("complete", "incomplete")
"""Of a recording of positions that can be used: what the key has not done yet moves nothing."""


@dataclass(frozen=True, eq=False)
class DisplacementReading:
    """One sensor of one trial."""

    position: Position  # as recorded, with flags and uncertainties
    value_m: Array  # (n,), displacement from rest, hum taken off, smoothed, m
    quiet: int  # samples of the rest
    u_zero_m: float  # standard uncertainty of level and hum that the rest leaves, m


def measure_positions(data: TrialData, calibration: SensorCalibration, seal: str = "") -> MeasuredTrial:
    """Trial of key and hammer measured by one position sensor each, with the errors of ``calibration``: the key drives
    the model. ``seal``: SHA-256 of the trial. Raises a trial error where a sensor is missing, misplaced or too briefly
    at rest."""
    found = {}
    for body in ("key", "hammer"):
        names = [c.name for c in data.channels if c.ruler is not None and c.ruler.body == body]
        if len(names) != 1:
            raise TrialError(f"{len(names)} position sensors of the {body}, allowed 1; found {data.position_names}")
        found[body] = _measure_displacement(data, names[0], body)
    key, hammer = found["key"], found["hammer"]
    travel = key.position.travel_m, hammer.position.travel_m
    sensors = PositionSensors(data.time_s, key.value_m, *travel, calibration, _places(found))
    sensors.check_sensors()
    per_m = [turn / length for turn, length in zip(reference_turns(), travel, strict=True)]
    noise = [per * NOISE_M[body] for per, body in zip(per_m, found, strict=True)]
    steady = [
        per * float(np.hypot(np.median(one.position.u_calibration_m), one.u_zero_m))
        for per, one in zip(per_m, found.values(), strict=True)
    ]
    relative = PRIOR_U * np.array(calibration.u)
    lost = np.full(data.time_s.size, np.nan)
    stop = min(key.quiet, hammer.quiet)
    start_s = float(data.time_s[0])
    u = np.array([steady[0], np.nan, steady[1]])
    resolution = np.sqrt(12.0) * np.array([noise[0], np.nan, noise[1]])
    scale = np.array([relative[0], np.nan, relative[3]])
    read_motion = partial(
        motion_of,
        reference_geometry(),
        u_sample_rad=resolution / np.sqrt(12.0),
        u_zero_rad=u,
        u_scale_relative=scale,
    )
    quiet = Quiet(stop, start_s, float(data.time_s[stop - 1]), _onset_s(data, key))
    return MeasuredTrial(
        number=data.number,
        time_s=data.time_s,
        raw_force_n=lost,
        force=make_absent_force(data.time_s, quiet),
        quiet=quiet,
        change_rad=np.column_stack([-sensors.key_turn_rad(), lost, sensors.as_turn(hammer.value_m)]),
        u_rad=u,
        resolution_rad=resolution,
        scale_relative_u=scale,
        read_motion=read_motion,
        film=None,
        seal=seal,
        notes=tuple(_cut_short(data)),
        samples=sample_fingerprints(data),
        sensors=sensors,
        driven_by_key=True,
    )


def _places(found: dict[str, DisplacementReading]) -> dict[str, str]:
    """Places of the sensors and of the calibrated points, as text."""
    out = {}
    for body, one in found.items():
        out[f"{body} sensor"] = one.position.ruler.sensor_at
        out[f"{body} calibrated point"] = f"{one.position.ruler.calibrated_at}, {1e3 * one.position.travel_m:.2f} mm"
    return out


def _onset_s(data: TrialData, key: DisplacementReading) -> float:
    """Time, s, at which the key first exceeds 1 % of its travel from rest."""
    return float(data.time_s[int(np.argmax(key.value_m > 0.01 * key.value_m.max()))])


def _cut_short(data: TrialData) -> list[str]:
    return [] if data.status == "complete" else [f"recorded {data.status}: {data.reason or 'no reason given'}"]


def _measure_displacement(data: TrialData, name: str, body: str) -> DisplacementReading:
    """Displacement, m, from rest of ``body`` (key or hammer) by the position channel ``name``: hum and offset at rest
    removed, smoothed; raises a trial error where the rest before the stroke is shorter than a period of the mains."""
    k = [channel.name for channel in data.channels].index(name)
    info, reading = data.channels[k], data.channel_values
    assert info.ruler is not None and reading is not None
    mains_hz = float(data.provenance.get(MAINS, "60"))
    quiet, needed = (
        _count_rest_samples(data, reading[:, k], info, 1.0 / mains_hz),
        round(data.sample_rate_hz / mains_hz),
    )
    if quiet < max(needed, FEWEST):
        raise TrialError(
            f"{name}: found {1e3 * quiet / data.sample_rate_hz:.0f} ms at rest, one period of the mains before the "
            f"stroke; needed {1e3 * max(needed, FEWEST) / data.sample_rate_hz:.0f}, for in less than a period hum has "
            "a level of its own; the stroke is left out"
        )
    at_rest = np.arange(data.time_s.size) < quiet
    _, hum, _, _, u_reading = fit_mains_hum(data.time_s, reading[:, k], at_rest, np.array([mains_hz]))
    zero = float(np.median((reading[:, k] - hum)[:quiet])) - float(info.ruler.reading[0])
    values = reading.copy()
    values[:, k] -= hum
    position = replace(data, channel_values=values).position(name, zero)
    value = smooth_to_noise(position.displacement_m, position.u_noise_m, NOISE_M[body])
    value = value - float(np.median(value[:quiet]))
    slope = np.abs(ruler_curve(info.ruler, name).slope(values[:, k] - zero))
    return DisplacementReading(position, value, quiet, float(np.max(u_reading * slope)))


def _count_rest_samples(data: TrialData, reading: Array, info: ChannelInfo, period_s: float) -> int:
    """Number of samples at rest with which a trial begins, 0.25 s at most, from the ``reading`` (n,) of one position
    channel, its ``info`` and the period of the mains, s; 0 where the record is too short.

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
    back = np.abs(mean - mean[0]) <= unsure + SIGMAS * noise * np.sqrt(2.0 * step / period_s)
    return int(np.count_nonzero(time_s < min(float(at[back][-1]) - period_s, QUIET_S)))


def smooth_to_noise(value: Array, u_noise: Array, wanted: float) -> Array:
    """``value`` (n,) averaged with Gaussian weights over as many neighbours, 40 at most, as bring its noise ``u_noise``
    (n,) down to ``wanted``; all in one unit."""
    neighbours = np.clip((u_noise / wanted) ** 2, 1.0, MOST_NEIGHBOURS)
    width = neighbours / (2.0 * np.sqrt(np.pi))  # standard deviation, in samples, of Gaussian weights worth so many
    reach = int(np.ceil(3.0 * width.max()))
    out, padded = np.zeros(value.size), np.pad(value, reach, mode="edge")
    weight = np.zeros(value.size)
    for k in range(-reach, reach + 1):
        share = np.exp(-0.5 * (k / np.maximum(width, 0.05)) ** 2)  # of a sample: no neighbour has a share
        out += share * padded[reach + k : reach + k + value.size]
        weight += share
    return out / weight
