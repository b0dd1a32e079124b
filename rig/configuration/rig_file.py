"""The rig file: which device, channels, scales, signs and limits the bench has (TOML, checked, frozen).

Conventions: SI units, names carry units, encoder order key, whippen, hammer, sign +1 when counts rise as the body turns
counter-clockwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from rig.atomic_write import sha256_of_bytes
from rig.configuration import toml_file
from rig.errors import refuse

BODIES = ("key", "whippen", "hammer")
COUNTS_PER_REVOLUTION = {"key": 327_680, "whippen": 327_680, "hammer": 163_840}
"""Of the encoders of the built-in rig, as a place to start from."""
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True)]
Text = Annotated[str, Field(min_length=1)]


class Table(BaseModel):
    """A table of the rig file: frozen, unknown keys refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


SCALE_KEYS = ("scale", "custom_scale", "custom_scale_name", "max_scale")


class ScaledTable(Table):
    """A table of a channel, whose scaling stands in the rig file: a scale of NI MAX would not be in the session."""

    @model_validator(mode="before")
    @classmethod
    def _refuse_max_scale(cls, values: Any) -> Any:
        """Return the values of the table, before they are checked, unchanged; ValueError for a key that names a scale
        of NI MAX."""
        named = [key for key in SCALE_KEYS if isinstance(values, dict) and key in values]
        if named:
            line = " and ".join(name for name in ("electrical", "physical", "physical_n") if name in cls.model_fields)
            table = ", a table as ruler" if "ruler" in cls.model_fields else ""
            raise ValueError(
                f"{named[0]} = {values[named[0]]!r}: scales of NI MAX are not used; give the slope as {line}{table}"
            )
        return values


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


class ForceConfig(ScaledTable):
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
    excitation_v: Number = Field(default=2.5, ge=0.5, le=10)  # one of the four that an NI 9237 supplies
    bridge_resistance_ohm: Number = Field(default=350.0, ge=60, le=5000)  # the usual full bridge of a load cell
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
    def _check_calibration_points(self) -> ForceConfig:
        """Refuse calibration points that are equal, and a range whose least force is not below its largest."""
        refuse(
            ValueError,
            (
                self.electrical[0] == self.electrical[1] or self.physical_n[0] == self.physical_n[1],
                f"force: the two calibration points {self.electrical} and {self.physical_n} must differ",
            ),
            (not self.min_n < self.max_n, f"force.min_n = {self.min_n:g}, allowed below force.max_n = {self.max_n:g}"),
        )
        return self

    @property
    def electrical_unit(self) -> str:
        return "mV/V" if self.kind == "bridge" else "V"

    def group_delay(self, sample_rate_hz: float) -> float:
        """Delay, s, from the force on the cell to its sample: ``group_delay_s`` of the rig file, else that of the
        module at this sample rate, Hz, where it is an NI 9237, else 0.

        NI 9237: (40 + 5/512)/fs + 4.5 µs (National Instruments, KB kA00Z0000004A0YSAU).
        """
        if self.group_delay_s is not None:
            return self.group_delay_s
        return (40 + 5 / 512) / sample_rate_hz + 4.5e-6 if "9237" in self.module else 0.0  # its data sheet


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
    def _check_points(self) -> RulerConfig:
        """Refuse readings and displacements of different numbers, and displacements that do not rise."""
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


class ChannelConfig(ScaledTable):
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
    def _check_calibration_points(self) -> ChannelConfig:
        """Refuse calibration points that are equal, a range in the wrong order, and a name that every trial uses
        already."""
        refuse(
            ValueError,
            (
                self.electrical[0] == self.electrical[1] or self.physical[0] == self.physical[1],
                f"{self.name}: the two calibration points {self.electrical} and {self.physical} must differ",
            ),
            (not self.least < self.most, f"{self.name}: least = {self.least:g}, allowed below most = {self.most:g}"),
            (
                self.name in RESERVED_NAMES,
                f"channel name {self.name!r} is taken by every trial ({', '.join(RESERVED_NAMES)})",
            ),
        )
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
    filter_min_pulse_s: Number = Field(default=1e-7, ge=0, le=1e-3)  # the shortest input filter of the counters
    arc_gain: Number = Field(default=1.0, gt=0.8, lt=1.25)
    """True angle over reading, over the arc the body turns (``pianorig calibrate encoder``)."""
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
    u_scale_radius_m: Number = Field(default=1e-5, ge=0, le=0.01)  # choice: a turned disc


class MotorConfig(Table):
    """The analog output that commands the motor's torque, and the limits of the command."""

    channel: Text
    force_per_volt_n: Number = Field(gt=0, le=100)
    voltage_limit_v: Number = Field(default=10.0, gt=0, le=10)  # range of the outputs
    force_limit_n: Number = Field(gt=0, le=120)
    slew_limit_n_per_s: Number = Field(default=2000.0, gt=0, le=100_000)  # choice: 50 N in 25 ms
    rms_force_limit_n: Number = Field(default=30.0, gt=0, le=120)  # heating of the motor: choice, give its own
    rms_over_s: Number = Field(default=10.0, gt=0, le=1000)  # thermal time of its winding: choice

    @model_validator(mode="after")
    def _check_force_limit(self) -> MotorConfig:
        """Refuse a limit of force beyond the motor's force at the limit of voltage."""
        reach = self.force_per_volt_n * self.voltage_limit_v
        if self.force_limit_n > reach * (1 + 1e-9):
            raise ValueError(
                f"motor.force_limit_n = {self.force_limit_n:g} N, allowed at most {reach:g} N "
                "(force_per_volt_n times voltage_limit_v)"
            )
        return self


class ArmConfig(Table):
    """Rotor and arm of the motor, for the dry run: what the blow does, and what the arm does if it meets no key.

    ``free_travel_rad`` is the angle from the key's surface to the arm's hard stop.
    """

    length_m: Number = Field(gt=0, le=1)
    inertia_kg_m2: Number = Field(gt=0, le=0.1)
    friction_nm: Number = Field(default=1e-4, ge=0, le=1)  # choice: a ball bearing; 1 mN at 0.1 m
    spring_nm_per_rad: Number = Field(default=0.0, ge=0, le=10)
    contact_stiffness_n_per_m: Number = Field(default=2e5, gt=0, le=1e8)  # of the arm's tip on wood: choice
    contact_damping_s_per_m: Number = Field(default=0.5, ge=0, le=10)
    free_travel_rad: Number = Field(gt=0, le=3.1)
    free_speed_limit_rad_per_s: Number = Field(default=100.0, gt=0, le=10_000)
    free_energy_limit_j: Number = Field(default=1.0, gt=0, le=1000)


class CameraConfig(Table):
    """The camera's counter. ``mode`` "pulses": it gives the frame pulses, exposure starts on each rising edge;
    "counted": the camera runs by itself and the counter counts the edges of its exposure signal."""

    mode: Literal["pulses", "counted"] = "pulses"
    counter: Text
    terminal: Text
    frame_rate_hz: Number = Field(ge=1, le=1_000_000)
    start_delay_s: Number = Field(default=0.0, ge=0, le=10)
    exposure_s: Number = Field(gt=0, le=1)
    u_time_s: Number = Field(default=1e-6, ge=0, le=0.01)

    @model_validator(mode="after")
    def _check_exposure(self) -> CameraConfig:
        if self.exposure_s > 1 / self.frame_rate_hz:
            raise ValueError(
                f"camera.exposure_s = {self.exposure_s:g} s, allowed at most one frame period, "
                f"{1 / self.frame_rate_hz:g} s"
            )
        return self


class DriveEnableConfig(Table):
    """The digital line that enables the motor drive; high is enabled."""

    line: Text


class FeltConfig(Table):
    """The arm as a press for felts (``pianorig record --felt``).

    The scale of ``encoder`` is mounted on the motor's shaft for this. ``compliance_m_per_n`` is that of arm and load
    cell between shaft and felt; ``record --felt block`` measures it. Beyond ``force_limit_n`` or ``depth_limit_m`` the
    press ends at once.
    """

    encoder: Literal["key", "whippen", "hammer"] = "key"
    radius_m: Number = Field(gt=0, le=1)
    """From the shaft to where the felt is touched."""
    u_radius_m: Number = Field(default=1e-4, ge=0, le=0.01)  # as read on a ruler
    compliance_m_per_n: Number = Field(ge=0, le=1e-3)
    u_compliance_m_per_n: Number = Field(ge=0, le=1e-3)
    force_limit_n: Number = Field(default=50.0, gt=0, le=120)  # choice: above the 34 N of a forte
    depth_limit_m: Number = Field(default=3e-3, gt=0, le=0.02)  # choice: contact02 gives 0.75 mm at 30 N


class FurtherDevice(Table):
    """A card or chassis beside the main one, and how it gets the main one's sample clock.

    ``link`` "RTSI": both are on one RTSI cable, registered in NI MAX; the driver routes clock and trigger. "lines": the
    main device puts its sample clock out on ``clock_from``, a wire takes it to ``clock_to`` of this one. A device that
    runs on its own timebase is not offered: two of them part by up to 50 us in a second.
    """

    product: Literal["cDAQ-9189", "PCIe-6363", "PCI-6034E", "PCI-6602", "PCI-6733"]
    name: Text
    link: Literal["RTSI", "lines"]
    clock_from: Text | None = None
    clock_to: Text | None = None

    @model_validator(mode="after")
    def _check_wires(self) -> FurtherDevice:
        """Refuse a device on lines without both ends of its clock's wire, one on RTSI with them, and a chassis on RTSI,
        which it has not."""
        wires = [self.clock_from, self.clock_to]
        refuse(
            ValueError,
            (
                self.link == "lines" and None in wires,
                f"{self.name}: link = 'lines' needs clock_from and clock_to, the ends of the wire",
            ),
            (
                self.link == "RTSI" and wires != [None, None],
                f"{self.name}: link = 'RTSI' has no clock_from and clock_to; the driver finds the lines",
            ),
            (
                self.link == "RTSI" and self.product.startswith("cDAQ"),
                f"{self.name}: a {self.product} has no RTSI; allowed link = 'lines'",
            ),
        )
        return self

    def owns(self, channel: str) -> bool:
        first = channel.removeprefix("/").split("/", 1)[0].lower()
        return first == self.name.lower() or (
            self.product.startswith("cDAQ") and first.startswith(self.name.lower() + "mod")
        )


FOLDER = Path(__file__).parents[1] / "rigs"


class LimitsConfig(Table):
    """What ends a trial at once (:mod:`rig.safety.interlocks`); bodies in the order key, whippen, hammer.

    The defaults are about three times what a forte blow reaches on the virtual bench (34 N, 35 kN/s, 3.5, 8 and
    18 rad/s, 0.05, 0.09 and 0.36 rad).
    """

    force_min_n: Number = Field(default=-10.0, ge=-1000, le=0)  # the arm rests, it does not pull
    force_max_n: Number = Field(default=110.0, gt=0, le=1000)  # three times a forte's
    force_rate_n_per_s: Number = Field(default=250_000.0, gt=0)  # seven times a forte's 35 kN/s
    speed_rad_per_s: tuple[Number, Number, Number] = (15.0, 40.0, 100.0)  # four to five times a forte's
    travel_rad: tuple[Number, Number, Number] = (0.12, 0.25, 1.2)  # 2.4 to 3.3 times a forte's
    return_rad: Number = Field(default=0.005, gt=0, le=1)  # 1 mm at the key's front
    baseline_n: tuple[Number, Number] = (-1.0, 1.0)
    least_preload_n: Number | None = None
    push_n: Number = Field(default=3.0, gt=0, le=120)  # choice: a tenth of a forte
    no_force_s: Number = Field(default=0.005, ge=0.001, le=0.2)  # choice: a quarter of a block
    stuck_s: Number = Field(default=0.005, ge=0.001, le=0.2)  # choice, as no_force_s


class WatchdogConfig(Table):
    """The device's watchdog timer: outputs made safe when the program has not reset it for ``timeout_s``."""

    timeout_s: Number = Field(default=0.5, ge=0.05, le=30)  # 25 blocks of 20 ms


class SafetyConfig(Table):
    """Who may let the motor move: ``--yes`` instead of a typed confirmation, and how old a self-test may be."""

    allow_yes: bool = Field(default=False, strict=True)
    selftest_valid_h: Number = Field(default=24.0, gt=0, le=8760)  # one day of measuring


class SelftestConfig(Table):
    """What ``pianorig selftest`` expects of a sound bench.

    ``stroke_rad`` is how far key, whippen and hammer turn, counter-clockwise positive, when the key is pressed to its
    bottom by hand. ``push_n`` must not move the key. ``shunt_ohm`` is the module's shunt resistor, 0 for none.
    """

    stroke_rad: tuple[Number, Number, Number]
    stroke_tolerance: Number = Field(default=0.15, gt=0, le=0.4)  # by hand: choice; swapped scales differ by 2
    push_n: Number = Field(default=0.25, gt=0, le=5)  # half of what moves a key
    push_tolerance: Number = Field(default=0.2, gt=0, le=0.5)  # of a push: choice; a wrong gain is off by 2
    latency_tolerance_samples: Number = Field(default=0.5, gt=0, le=100)
    drive_delay_s: Number = Field(default=0.0, ge=0, le=0.01)
    """From the analog output to the torque."""
    offset_limit_n: Number = Field(default=2.0, gt=0, le=100)  # of the unloaded cell: choice
    shunt_ohm: Number = Field(default=100e3, ge=0)  # inside an NI 9237
    shunt_tolerance: Number = Field(default=0.02, gt=0, le=0.5)  # of the step: choice
    loopback: Text | None = None
    """A voltage input that is wired to the motor's output, if there is one."""


class RecordingConfig(Table):
    """Timing of a trial and what counts as rest."""

    quiet_s: Number = Field(default=0.35, ge=0.3, le=10)  # 17 periods of 50 Hz for offset and hum
    rest_s: Number = Field(default=0.2, ge=0.2, le=10)  # in which all must rest: ten periods of 50 Hz
    rest_counts: Count = Field(default=1, ge=0, le=1000)
    rest_force_n: Number = Field(default=0.2, gt=0, le=10)  # choice: half of what moves a key
    longest_s: Number = Field(default=3.0, ge=0.5, le=900)
    block_s: Number = Field(default=0.02, ge=0.001, le=1)  # what a limit may act late: one period of 50 Hz


class PassiveConfig(Table):
    """What a stroke of a player is (``record --passive``): when it begins and ends.

    ``pre_s`` of quiet time is kept before it. Force or key must leave their level by ``trigger_n`` or ``trigger_rad``;
    encoders are still within ``still_rad``; ``longest_s`` ends a stroke whose key is held.
    """

    pre_s: Number = Field(default=0.5, ge=0.3, le=10)
    trigger_n: Number = Field(default=0.5, gt=0, le=20)
    trigger_rad: Number = Field(default=0.002, gt=0, le=0.1)  # 0.4 mm at the key's front
    still_rad: Number = Field(default=5e-4, gt=0, le=0.1)  # 0.1 mm at the key's front
    longest_s: Number = Field(default=10.0, ge=0.5, le=900)  # choice: no stroke is held so long


class RigConfig(Table):
    """A whole rig file."""

    schema_name: Literal["piano-action-rig rig 1"] = Field(alias="schema")
    name: Text
    mains_frequency_hz: Number = Field(ge=40, le=70)
    device: DeviceConfig
    devices: tuple[FurtherDevice, ...] = ()
    force: ForceConfig
    encoders: tuple[EncoderConfig, EncoderConfig, EncoderConfig]
    channels: tuple[ChannelConfig, ...] = ()
    key_opposite: OppositeHeadConfig | None = None
    motor: MotorConfig
    arm: ArmConfig | None = None
    camera: CameraConfig | None = None
    drive_enable: DriveEnableConfig | None = None
    watchdog: WatchdogConfig | None = None
    limits: LimitsConfig = LimitsConfig()
    safety: SafetyConfig = SafetyConfig()
    selftest: SelftestConfig | None = None
    recording: RecordingConfig = RecordingConfig()
    passive: PassiveConfig = PassiveConfig()
    felt: FeltConfig | None = None

    @model_validator(mode="after")
    def _check_consistency(self) -> RigConfig:
        """Refuse tables that contradict each other: encoders in another order, a counter or terminal used twice, too
        fast a counted camera, a watchdog that reaches no output or is shorter than two blocks."""
        names = tuple(encoder.name for encoder in self.encoders)
        if names != BODIES:
            raise ValueError(f"encoders are named {names}, allowed {BODIES} in this order")
        heads: list[EncoderConfig | OppositeHeadConfig] = [*self.encoders]
        heads += [self.key_opposite] if self.key_opposite is not None else []
        counters = [head.counter for head in heads]
        if self.camera is not None:
            counters.append(self.camera.counter)
        # on a chassis, Mod3/ctr0 and Mod4/ctr0 are the same counter
        used = [(self.device_of(counter), counter.rsplit("/", 1)[-1].lower()) for counter in counters]
        if len(set(used)) != len(used):
            raise ValueError(
                f"encoders and camera use the counters {counters}, allowed one task per counter; give each its own"
            )
        self._check_channels()
        self._check_devices()
        camera, rate = self.camera, self.device.sample_rate_hz
        if camera is not None and camera.mode == "counted" and camera.frame_rate_hz > rate / 2:
            raise ValueError(
                f"camera.frame_rate_hz = {camera.frame_rate_hz:g} Hz, allowed at most {rate / 2:g} Hz (half of "
                "device.sample_rate_hz) where exposures are counted"
            )
        drive = self.drive_enable.line if self.drive_enable is not None else None
        reach = [name for name in (self.motor.channel, drive) if name is not None and self.device_of(name) is None]
        longest_s = self.watchdog.timeout_s / 2 if self.watchdog is not None else math.inf
        terminals = [t for head in heads for t in (head.a_terminal, head.b_terminal)]
        refuse(
            ValueError,
            (
                self.watchdog is not None and not reach,
                f"watchdog: neither motor.channel nor drive_enable.line is on {self.device.name}, whose watchdog it "
                "is; allowed with one of them there, or no [watchdog]",
            ),
            (
                self.recording.block_s > longest_s,
                f"recording.block_s = {self.recording.block_s:g} s, allowed at most half of watchdog.timeout_s = "
                f"{2 * longest_s:g} s",
            ),
            (
                len(set(terminals)) != len(terminals),
                f"encoder terminals {terminals} repeat; each signal needs its own terminal",
            ),
        )
        return self

    def device_of(self, channel: str) -> FurtherDevice | None:
        """Return the further device a channel or terminal belongs to; None for the main one's."""
        return next((device for device in self.devices if device.owns(channel)), None)

    def clock_of(self, channel: str) -> str:
        """Return the terminal from which a channel's task takes the sample clock."""
        further = self.device_of(channel)
        on_wire = further is not None and further.link == "lines"
        return str(further.clock_to) if on_wire and further is not None else f"/{self.device.name}/ai/SampleClock"

    def start_of(self, channel: str) -> str | None:
        """Return the terminal of the start trigger; None where only the clock is wired: with that it begins as well."""
        further = self.device_of(channel)
        return f"/{self.device.name}/ai/StartTrigger" if further is None or further.link == "RTSI" else None

    def _check_devices(self) -> None:
        """Refuse device names that repeat, RTSI beside a chassis, force, channels or frame pulses on a further device,
        and clock terminals on the wrong device."""
        names = [self.device.name.lower(), *(further.name.lower() for further in self.devices)]
        refuse(
            ValueError,
            (len(set(names)) != len(names), f"devices are named {names}; each needs a name of its own"),
            (
                any(further.link == "RTSI" for further in self.devices) and self.device.product.startswith("cDAQ"),
                f"device.product = {self.device.product}: has no RTSI; allowed link = 'lines'",
            ),
        )
        for channel in (self.force.channel, *(channel.channel for channel in self.channels)):
            if (further := self.device_of(channel)) is not None:
                raise ValueError(
                    f"{channel}: is on {further.name}; force and further channels give the clock, allowed on "
                    f"{self.device.name} only"
                )
        pulses = self.camera is not None and self.camera.mode == "pulses"
        if self.camera is not None and pulses and (further := self.device_of(self.camera.counter)) is not None:
            raise ValueError(
                f"camera.counter = {self.camera.counter}: frame pulses of {further.name} run on its own timebase, some "
                f"50 us a second beside {self.device.name}; allowed a counter there, or camera.mode = 'counted'"
            )
        for further in self.devices:
            refuse(
                ValueError,
                (
                    further.clock_to is not None and not further.owns(further.clock_to),
                    f"{further.name}: clock_to = {further.clock_to}, allowed a terminal of {further.name}",
                ),
                (
                    further.clock_from is not None and self.device_of(further.clock_from) is not None,
                    f"{further.name}: clock_from = {further.clock_from}, allowed a terminal of {self.device.name}",
                ),
            )

    def _check_channels(self) -> None:
        """Refuse further channels beside a force bridge, and names or inputs of force and channels that repeat."""
        if self.channels and self.force.kind != "voltage":
            raise ValueError(
                f"channels: {len(self.channels)} voltage inputs, allowed 0 where force.kind = {self.force.kind!r}: "
                "they share the force's task, and a bridge module has no voltage inputs"
            )
        names = [channel.name for channel in self.channels]
        inputs = [self.force.channel.lower(), *(channel.channel.lower() for channel in self.channels)]
        for what, listed in (("names", names), ("inputs", inputs)):
            if len(set(listed)) != len(listed):
                raise ValueError(f"{what} of force and channels {listed} repeat, allowed each once")


@dataclass(frozen=True)
class Rig:
    """A checked rig file with its text, so that a session can keep both."""

    config: RigConfig
    text: str
    sha256: str
    source: str


def load_rig(name: str | Path = "virtual") -> Rig:
    """Load the built-in rig file of this name, or the TOML file of this path, checked; RigInputError for neither, or a
    value that is not allowed.

    Parameters
    ----------
    name : str or path

    Returns
    -------
    Rig
        The checked description with its text and SHA-256.

    Raises
    ------
    RigInputError
        When the file is missing, not TOML, or has a value outside its allowed range.

    Examples
    --------
    >>> import rig
    >>> rig.load_rig("virtual").config.device.sample_rate_hz
    5000.0
    """
    path = toml_file.find_toml(name, FOLDER, "rig file")
    return parse_rig(toml_file.read_text(path), str(path))


def parse_rig(text: str, where: str = "rig file") -> Rig:
    """Check the text of a TOML file as a rig file; RigInputError, which begins with ``where``, for text that is none or
    a value that is not allowed.

    Parameters
    ----------
    text : str
    where : str
        What to call it in errors.

    Returns
    -------
    Rig

    Raises
    ------
    RigInputError
        When the text is not TOML, or has a value outside its allowed range.

    Examples
    --------
    >>> from pathlib import Path
    >>> import rig
    >>> rig.parse_rig(Path("my_rig.toml").read_text("utf-8"), "my_rig.toml").config.name
    'my_rig'
    """
    toml_file.refuse_nul(text, where)
    config = toml_file.check(RigConfig, toml_file.parse_toml(text, where), where)
    return Rig(config, text, sha256_of_bytes(text.encode("utf-8")), where)
