"""The sensors of the virtual bench: a load cell with an output in millivolts per volt, encoders that count.

The 9237's decimation filter is modelled by its group delay only (linear interpolation between sample edges); before a
trial starts the force has its value at the first edge. Noise and hum are added after the delay, so that they are read
in their stated size.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from model.observables import encoder_rad
from rig.configuration import toml_file
from rig.configuration.rig_file import Count, Number, Table
from rig.simulated.bench.plant_protocol import ENCODED_BODIES, read_bench


class DelayLine:
    """A signal known at sample edges, read ``delay_samples`` (≥ 0, need not be whole) earlier."""

    def __init__(self, delay_samples: float) -> None:
        self.delay_samples = delay_samples
        self._history: NDArray[np.float64] | None = None

    def push(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take the next n samples of a signal and return it (n,) as it was `delay_samples` earlier, interpolated
        linearly; before its first sample it stood at that value."""
        if values.size == 0 or self.delay_samples == 0.0:
            return values
        length = int(np.ceil(self.delay_samples)) + 1
        if self._history is None:
            self._history = np.full(length, values[0])
        line = np.concatenate((self._history, values))
        position = np.arange(self._history.size, line.size) - self.delay_samples
        self._history = line[-length:]
        return np.interp(position, np.arange(line.size), line)


def quantise(values: NDArray[np.float64], half_range: float, bits: int) -> NDArray[np.float64]:
    step = 2 * half_range / 2**bits
    return np.clip(np.rint(values / step), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1) * step


_FORCE_STREAM, _ENCODER_STREAM, _MOUNTING_STREAM = 1, 2, 7  # of the random numbers
FIRST_COUNT = 0.37  # of a count, where a body at rest lies in it: any
OPPOSITE_LINE_RAD = 2.1  # phase of the line division at a second head: any angle, it is mounted as it is
TAKEN_UP_RAD = 0.005  # turn of a body over which the shift of its pivot comes about: choice


class ForceSensor(Table):
    """Table ``[force_sensor]`` of the bench file: the real load cell with its errors."""

    sensitivity_mv_per_v: Number = Field(gt=0, le=100)
    full_scale_n: Number = Field(gt=0, le=100_000)
    noise_n: Number = Field(ge=0)
    offset_n: Number = 0.0
    offset_scatter_n: Number = Field(default=0.0, ge=0)
    gain_error: Number = Field(default=0.0, gt=-0.5, lt=0.5)
    hum_n: tuple[Number, ...] = ()
    hum_hz: Number = Field(default=60.0, gt=0, le=1000)
    hum_phase_rad: tuple[Number, ...] = ()
    hum_phase_scatter: bool = Field(default=True, strict=True)
    saturation_mv_per_v: Number = Field(default=25.0, gt=0)  # range of an NI 9237


class EncoderSensor(Table):
    """Table ``[encoders.<body>]`` of the bench file: the real scale and the sense it is mounted in.

    A scale whose centre moves past the sensor by d reads d / ``scale_radius_m`` too much; without a radius it does not.
    """

    counts_per_revolution: Count = Field(ge=4, multiple_of=4)
    sign: Literal[1, -1] = 1
    scale_radius_m: Number | None = Field(default=None, gt=1e-3, le=1.0)
    lines_per_revolution: Count = Field(default=2048, ge=1)  # choice
    interpolation_rad: Number = Field(default=0.0, ge=0, le=0.01)
    """Amplitude of the error that repeats with each line of the scale."""
    eccentricity_rad: Number = Field(default=0.0, ge=0, le=0.1)
    """Amplitude of the error that repeats with each revolution; its phase belongs to the bench."""
    pivot_shift_rad: Number = Field(default=0.0, ge=0, le=0.01)
    """Standard deviation, trial to trial, of the shift of a pivot that its body's first motion takes up."""


class _Encoders(Table):
    key: EncoderSensor
    whippen: EncoderSensor
    hammer: EncoderSensor


class _BenchTables(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")  # the rest of the bench file belongs to the plant
    force_sensor: ForceSensor
    encoders: _Encoders
    seed: Count = Field(default=0, ge=0)


@dataclass(frozen=True)
class SensorSet:
    """All sensors of the bench, and the seed of what scatters."""

    force: ForceSensor
    encoders: tuple[EncoderSensor, EncoderSensor, EncoderSensor]
    seed: int = 0


def load_sensors(bench: Path | Mapping[str, Any], *, seed: int | None = None) -> SensorSet:
    """Read the sensor tables of a bench file (path or parsed TOML); ``seed`` overrides the file's."""
    if isinstance(bench, Path):
        where, data = str(bench), read_bench(bench)
    else:
        where, data = "bench", dict(bench)
    tables = toml_file.check(_BenchTables, data, where)
    encoders = tables.encoders
    return SensorSet(
        tables.force_sensor, (encoders.key, encoders.whippen, encoders.hammer), tables.seed if seed is None else seed
    )


class ForceSignal:
    """The load cell during one trial."""

    def __init__(self, sensor: ForceSensor, seed: int, trial: int) -> None:
        self.sensor, self._rng = sensor, np.random.default_rng([seed, trial, _FORCE_STREAM])
        self.offset_n = sensor.offset_n + sensor.offset_scatter_n * float(self._rng.standard_normal())
        mains_rad = float(self._rng.uniform(0, 2 * math.pi))
        stated = (*sensor.hum_phase_rad, *(0.0 for _ in sensor.hum_n))
        self.hum_phase_rad = tuple(
            phase + (order * mains_rad if sensor.hum_phase_scatter else 0.0)
            for order, phase in enumerate(stated[: len(sensor.hum_n)], 1)
        )

    def millivolts_per_volt(self, force_n: NDArray[np.float64], time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Output of the load cell (n,), mV/V, under a force (n,), N, at times (n,), s since the trial began: with gain
        error, offset, mains hum and fresh noise, limited to the amplifier's range."""
        sensor = self.sensor
        reading_n = (1 + sensor.gain_error) * force_n + self.offset_n
        for order, (amplitude, phase) in enumerate(zip(sensor.hum_n, self.hum_phase_rad, strict=True), 1):
            reading_n = reading_n + amplitude * np.sin(2 * np.pi * order * sensor.hum_hz * time_s + phase)
        reading_n = reading_n + sensor.noise_n * self._rng.standard_normal(force_n.size)
        output = reading_n * (sensor.sensitivity_mv_per_v / sensor.full_scale_n)
        return np.clip(output, -sensor.saturation_mv_per_v, sensor.saturation_mv_per_v)


class EncoderSignals:
    """The three scales during one trial: quarter-pulse positions, whole numbers, zero at the first edge."""

    def __init__(self, sensors: tuple[EncoderSensor, ...], seed: int, trial: int) -> None:
        self.sensors = sensors
        rng = np.random.default_rng([seed, trial, _ENCODER_STREAM])
        self._phase = rng.uniform(0, 1, len(ENCODED_BODIES))
        self._shift_rad = rng.standard_normal(len(ENCODED_BODIES)) * [s.pivot_shift_rad for s in sensors]
        mounted = np.random.default_rng([seed, _MOUNTING_STREAM])
        self._centre_rad, self._line_rad = mounted.uniform(0, 2 * np.pi, (2, len(ENCODED_BODIES)))
        self._rest_rad: NDArray[np.float64] | None = None
        self._first: NDArray[np.int64] | None = None
        self._first_opposite: int | None = None

    def error_rad(self, angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Error of the scales' readings beside rounding, (n, 3), for absolute angles (n, 3)."""
        if self._rest_rad is None:
            self._rest_rad = angle_rad[:1].copy()
        shifted = self._shift_rad * np.clip(np.abs(angle_rad - self._rest_rad) / TAKEN_UP_RAD, 0.0, 1.0)
        return self._scale_error_rad(angle_rad) + shifted

    def _scale_error_rad(self, angle_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """Error of line division and centring, (n, 3)."""
        lines = np.array([s.lines_per_revolution for s in self.sensors])
        divided = np.array([s.interpolation_rad for s in self.sensors]) * np.sin(lines * angle_rad + self._line_rad)
        centred = np.array([s.eccentricity_rad for s in self.sensors]) * np.sin(angle_rad + self._centre_rad)
        return divided + centred

    def opposite_counts(
        self, angle_rad: NDArray[np.float64], key_lift_m: NDArray[np.float64] | None = None
    ) -> NDArray[np.int64]:
        """X4 counts (n,) since the first edge of the trial of a second head opposite the key's, at absolute angles (n,
        3), rad, of key, whippen, hammer; a lift of the key (n,), m, acts on it with the opposite sign."""
        key, radius_m = self.sensors[0], self.sensors[0].scale_radius_m
        lift = 0.0 if key_lift_m is None or radius_m is None else -np.asarray(key_lift_m) / radius_m
        turned = angle_rad[:, 0] + lift
        divided = key.interpolation_rad * np.sin(
            key.lines_per_revolution * turned + self._line_rad[0] + OPPOSITE_LINE_RAD
        )
        centred = key.eccentricity_rad * np.sin(turned + self._centre_rad[0] + np.pi)
        shifted = self.error_rad(angle_rad)[:, 0] - self._scale_error_rad(angle_rad)[:, 0]
        per_rad = key.sign * key.counts_per_revolution / (2 * np.pi)
        at = (turned + divided + centred - shifted) * per_rad + self._phase[0] + FIRST_COUNT
        position = np.floor(at).astype(np.int64)
        if self._first_opposite is None:
            self._first_opposite = int(position[0])
        return position - self._first_opposite

    def quarter_counts(
        self, angle_rad: NDArray[np.float64], key_lift_m: NDArray[np.float64] | None = None
    ) -> NDArray[np.int64]:
        """X4 counts (n, 3) since the first edge of the trial of key, whippen and hammer at absolute angles (n, 3), rad,
        with each scale's sign and errors; ``key_lift_m`` (n,): rise of the key's pivot, which moves its scale past the
        head."""
        radius_m = self.sensors[0].scale_radius_m
        if key_lift_m is not None and radius_m is not None:
            angle_rad = angle_rad.copy()
            angle_rad[:, 0] = encoder_rad(angle_rad[:, 0], key_lift_m, radius_m)
        per_rad = np.array([s.sign * s.counts_per_revolution / (2 * np.pi) for s in self.sensors])
        read_rad = angle_rad + self.error_rad(angle_rad)
        position = np.floor(read_rad * per_rad + self._phase).astype(np.int64)
        if self._first is None:
            self._first = position[0].copy()
        return position - self._first
