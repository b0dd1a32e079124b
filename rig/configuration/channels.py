"""Tables of the rig file that say what is wired where: device, load cell, encoders, motor, arm, camera, drive.

Conventions: SI units, names carry units, encoder order key, whippen, hammer, sign +1 when counts rise as the body
turns counter-clockwise. pydantic refuses a value outside its range, :mod:`rig.configuration.toml_file` says so in one
line.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

BODIES = ("key", "whippen", "hammer")
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True)]
Text = Annotated[str, Field(min_length=1)]


class Table(BaseModel):
    """A table of the rig file: frozen, unknown keys refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class CertificateConfig(Table):
    """A calibration certificate: its number, who issued it, when (ISO date), and its standard uncertainty."""

    number: Text
    laboratory: Text
    date: Annotated[str, Field(pattern=r"^\d{4}-\d{2}-\d{2}$")]
    u_relative: Number = Field(ge=0, le=0.2)

    def __str__(self) -> str:
        return f"{self.number}, {self.laboratory}, {self.date}, u = {self.u_relative:g} relative"


class DeviceConfig(Table):
    """The DAQ device or chassis that provides the clocks."""

    product: Literal["cDAQ-9189", "PCIe-6363", "PCI-6034E"]
    name: Text
    sample_rate_hz: Number = Field(ge=100, le=50_000)


class ForceConfig(Table):
    """The load cell: a bridge module (mV/V), or a conditioner into a voltage input (V)."""

    kind: Literal["bridge", "voltage"] = "bridge"
    channel: Text
    module: Text
    sensor: Text
    calibration: Text
    electrical: tuple[Number, Number]
    physical_n: tuple[Number, Number]
    min_n: Number
    max_n: Number
    excitation_v: Number = Field(default=2.5, ge=0.5, le=10)
    bridge_resistance_ohm: Number = Field(default=350.0, ge=60, le=5000)
    group_delay_s: Number | None = Field(default=None, ge=0, le=0.1)
    u_group_delay_s: Number = Field(default=0.0, ge=0, le=0.01)
    u_noise_n: Number = Field(ge=0, le=10)
    u_gain_relative: Number = Field(ge=0, le=0.2)
    preload_n: Number = Field(ge=0, le=20)
    u_preload_n: Number = Field(ge=0, le=5)
    offset_n: Number | None = Field(default=None, ge=-100, le=100)
    """Reading of the channel with the arm lifted off the key, once known (``pianorig selftest`` measures it)."""
    certificate: CertificateConfig | None = None

    @model_validator(mode="after")
    def _line(self) -> ForceConfig:
        if self.electrical[0] == self.electrical[1] or self.physical_n[0] == self.physical_n[1]:
            raise ValueError(f"force: the two calibration points {self.electrical} and {self.physical_n} must differ")
        if not self.min_n < self.max_n:
            raise ValueError(f"force.min_n = {self.min_n:g}, allowed below force.max_n = {self.max_n:g}")
        return self

    @property
    def electrical_unit(self) -> str:
        """Unit of the electrical reading."""
        return "mV/V" if self.kind == "bridge" else "V"

    def group_delay(self, sample_rate_hz: float) -> float:
        """Delay from the force on the cell to its sample, s; from the module's data unless the rig file gives
        it.

        NI 9237: (40 + 5/512)/fs + 4.5 µs (National Instruments, KB kA00Z0000004A0YSAU).
        """
        if self.group_delay_s is not None:
            return self.group_delay_s
        return (40 + 5 / 512) / sample_rate_hz + 4.5e-6 if "9237" in self.module else 0.0


RESERVED_NAMES = (
    *("time", "force", "force_raw", "motor_command", "encoder", "encoder_count"),
    *("time_s", "force_n", "motor_command_v", "key_opposite_rad"),
    *(f"{body}_{column}" for body in BODIES for column in ("count", "rad")),
)
"""Datasets every trial has, and columns of its table."""


class RulerConfig(Table):
    """Ruler points of a position sensor: which point of which body, readings (unit of the channel) and displacement.

    ``sensor_at`` is where the sensor looks, ``calibrated_at`` the point beside the ruler; they may differ. The
    displacement rises as the key is pressed and as the hammer goes towards the string.
    """

    body: Literal["key", "whippen", "jack", "repetition", "hammer", "damper"]
    sensor_at: Text
    calibrated_at: Text
    reading: Annotated[tuple[Number, ...], Field(min_length=4, max_length=1000)]
    displacement_m: Annotated[tuple[Number, ...], Field(min_length=4, max_length=1000)]
    u_displacement_m: Number = Field(gt=0, le=0.01)
    u_reading: Number = Field(default=0.0, ge=0)

    @model_validator(mode="after")
    def _points(self) -> RulerConfig:
        if len(self.reading) != len(self.displacement_m):
            raise ValueError(
                f"ruler: {len(self.reading)} readings and {len(self.displacement_m)} displacements, allowed as many"
            )
        for i, (one, two) in enumerate(pairwise(self.displacement_m), 1):
            if not one < two:
                raise ValueError(
                    f"ruler: displacement_m falls from {one:g} to {two:g} at point {i + 1}, allowed are rising points"
                )
        return self


class ChannelConfig(Table):
    """A further voltage input on the clock of the force; what it measures is up to the lab.

    With a ``ruler`` it is a position sensor: the value (in ``unit``) is the reading of the ruler's points.

    ``physical``, ``least`` and ``most`` are in ``unit``, the calibration's points ``electrical`` in V; noise likewise.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
    channel: Text
    quantity: Text
    unit: Text
    sensor: Text
    calibration: Text
    electrical: tuple[Number, Number]
    physical: tuple[Number, Number]
    least: Number
    most: Number
    group_delay_s: Number = Field(default=0.0, ge=0, le=0.1)
    u_noise: Number = Field(default=0.0, ge=0)
    u_gain_relative: Number = Field(default=0.0, ge=0, le=0.2)
    certificate: CertificateConfig | None = None
    ruler: RulerConfig | None = None

    @model_validator(mode="after")
    def _line(self) -> ChannelConfig:
        if self.electrical[0] == self.electrical[1] or self.physical[0] == self.physical[1]:
            raise ValueError(
                f"{self.name}: the two calibration points {self.electrical} and {self.physical} must differ"
            )
        if not self.least < self.most:
            raise ValueError(f"{self.name}: least = {self.least:g}, allowed below most = {self.most:g}")
        if self.name in RESERVED_NAMES:
            raise ValueError(f"channel name {self.name!r} is taken by every trial ({', '.join(RESERVED_NAMES)})")
        return self


class EncoderConfig(Table):
    """One angular encoder on one counter; ``counts_per_revolution`` counts all four edges (X4).

    Standard uncertainties in addition to the quantisation (one count / sqrt 12): ``u_scale_relative`` of the scale,
    ``u_interpolation_rad`` of the divided line signal, ``u_eccentricity_rad`` of a scale off its centre (rad of error
    per rad turned, over the small arcs of an action), ``u_pivot_shift_rad`` of a pivot that moves in its bushing.
    """

    name: Literal["key", "whippen", "hammer"]
    counter: Text
    counts_per_revolution: Count = Field(ge=4, le=100_000_000, multiple_of=4)
    sign: Literal[1, -1]
    a_terminal: Text
    b_terminal: Text
    filter_min_pulse_s: Number = Field(default=1e-7, ge=0, le=1e-3)
    arc_gain: Number = Field(default=1.0, gt=0.8, lt=1.25)
    """True angle over reading, over the arc the body turns (``pianorig calibrate-encoder``)."""
    u_scale_relative: Number = Field(default=0.0, ge=0, le=0.1)
    u_interpolation_rad: Number = Field(default=0.0, ge=0, le=0.01)
    u_eccentricity_rad: Number = Field(default=0.0, ge=0, le=0.1)
    u_pivot_shift_rad: Number = Field(default=0.0, ge=0, le=0.01)
    max_pulse_rate_hz: Number = Field(default=1.0e6, gt=0, le=1e8)
    certificate: CertificateConfig | None = None

    @property
    def greatest_speed_rad_per_s(self) -> float:
        """Speed at which the pulse rate on A reaches the limit of the input or of its filter."""
        filtered_hz = 0.5 / self.filter_min_pulse_s if self.filter_min_pulse_s > 0 else math.inf
        return min(self.max_pulse_rate_hz, filtered_hz) * 2 * math.pi / self.pulses_per_revolution

    @property
    def rad_per_count(self) -> float:
        """Signed angle of one count as the encoder reads it, rad: without ``arc_gain``."""
        return self.sign * 2 * math.pi / self.counts_per_revolution

    @property
    def pulses_per_revolution(self) -> int:
        """Pulses on A (or B) per revolution, the quantity NI-DAQmx expects."""
        return self.counts_per_revolution // 4


class OppositeHeadConfig(Table):
    """A second reading head on the key's scale, opposite the first: rotation is their mean, lift half their difference.

    A scale whose centre rises by d reads d / ``scale_radius_m`` too much at one head and too little at the other; so
    does one that sits off its centre. Counts per revolution and filter are the key encoder's.
    """

    counter: Text
    a_terminal: Text
    b_terminal: Text
    sign: Literal[1, -1]
    scale_radius_m: Number = Field(gt=1e-3, le=1.0)
    u_scale_radius_m: Number = Field(default=1e-5, ge=0, le=0.01)


class MotorConfig(Table):
    """The analog output that commands the motor's torque, and the limits of the command."""

    channel: Text
    force_per_volt_n: Number = Field(gt=0, le=100)
    voltage_limit_v: Number = Field(default=10.0, gt=0, le=10)
    force_limit_n: Number = Field(gt=0, le=120)
    slew_limit_n_per_s: Number = Field(default=2000.0, gt=0, le=100_000)
    rms_force_limit_n: Number = Field(default=30.0, gt=0, le=120)
    rms_over_s: Number = Field(default=10.0, gt=0, le=1000)

    @model_validator(mode="after")
    def _reach(self) -> MotorConfig:
        reach = self.force_per_volt_n * self.voltage_limit_v
        if self.force_limit_n > reach * (1 + 1e-9):
            raise ValueError(
                f"motor.force_limit_n = {self.force_limit_n:g} N, allowed "
                f"at most {reach:g} N (scale "
                "times voltage_limit_v)"
            )
        return self


class ArmConfig(Table):
    """Rotor and arm of the motor, for the dry run: what the blow does, and what the arm does if it meets no key.

    ``free_travel_rad`` is the angle from the key's surface to the arm's hard stop.
    """

    length_m: Number = Field(gt=0, le=1)
    inertia_kg_m2: Number = Field(gt=0, le=0.1)
    friction_nm: Number = Field(default=1e-4, ge=0, le=1)
    spring_nm_per_rad: Number = Field(default=0.0, ge=0, le=10)
    contact_stiffness_n_per_m: Number = Field(default=2e5, gt=0, le=1e8)
    contact_damping_s_per_m: Number = Field(default=0.5, ge=0, le=10)
    free_travel_rad: Number = Field(gt=0, le=3.1)
    free_speed_limit_rad_per_s: Number = Field(default=100.0, gt=0, le=10_000)
    free_energy_limit_j: Number = Field(default=1.0, gt=0, le=1000)


class CameraConfig(Table):
    """The camera's counter. ``mode`` "pulses": it gives the frame pulses, exposure starts on each rising edge;
    "counted": the camera runs by itself and the counter counts the edges of its exposure signal.
    """

    mode: Literal["pulses", "counted"] = "pulses"
    counter: Text
    terminal: Text
    frame_rate_hz: Number = Field(ge=1, le=1_000_000)
    start_delay_s: Number = Field(default=0.0, ge=0, le=10)
    exposure_s: Number = Field(gt=0, le=1)
    u_time_s: Number = Field(default=1e-6, ge=0, le=0.01)

    @model_validator(mode="after")
    def _fits(self) -> CameraConfig:
        if self.exposure_s > 1 / self.frame_rate_hz:
            raise ValueError(
                f"camera.exposure_s = {self.exposure_s:g} s, allowed at most one frame period, "
                f"{1 / self.frame_rate_hz:g} s"
            )
        return self


class DriveEnableConfig(Table):
    """The digital line that enables the motor drive; high is enabled."""

    line: Text
