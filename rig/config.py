"""The rig file: which device, channels, scales, signs and limits the bench has (TOML, checked, frozen).

Place in the data flow: read before anything else; its text and SHA-256 go into every session. Conventions: SI
units, names carry units, encoder order key, whippen, hammer, sign +1 when counts rise as the body turns
counter-clockwise. A bad value is refused with file, key, value and allowed range
(:class:`rig.errors.InputError`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from rig import toml_file
from rig.durable import sha256_of_bytes
from rig.errors import InputError

FOLDER = Path(__file__).parent / "rigs"
BODIES = ("key", "whippen", "hammer")
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Count = Annotated[int, Field(strict=True)]
Text = Annotated[str, Field(min_length=1)]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class DeviceConfig(_Table):
    """The DAQ device or chassis that holds the clocks."""

    product: Literal["cDAQ-9189", "PCIe-6363"]
    name: Text
    sample_rate_hz: Number = Field(ge=100, le=50_000)


class ForceConfig(_Table):
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


class EncoderConfig(_Table):
    """One angular encoder on one counter; ``counts_per_revolution`` counts all four edges (X4)."""

    name: Literal["key", "whippen", "hammer"]
    counter: Text
    counts_per_revolution: Count = Field(ge=4, le=100_000_000, multiple_of=4)
    sign: Literal[1, -1]
    a_terminal: Text
    b_terminal: Text
    filter_min_pulse_s: Number = Field(default=1e-7, ge=0, le=1e-3)
    u_scale_relative: Number = Field(default=0.0, ge=0, le=0.1)

    @property
    def pulses_per_revolution(self) -> int:
        """Pulses on A (or B) per revolution, which is what NI-DAQmx asks for."""
        return self.counts_per_revolution // 4


class MotorConfig(_Table):
    """The analog output that commands the motor's torque, and the limits of what may be asked of it."""

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


class CameraConfig(_Table):
    """The counter that gives the camera its frame pulses; exposure starts on each rising edge."""

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


class DriveEnableConfig(_Table):
    """The digital line that enables the motor drive; high is enabled."""

    line: Text


class LimitsConfig(_Table):
    """What ends a trial at once (:mod:`rig.interlocks`); bodies in the order key, whippen, hammer.

    The defaults are about three times what a forte blow reaches on the virtual bench (34 N, 35 kN/s, 3.5, 8 and
    18 rad/s, 0.05, 0.09 and 0.36 rad).
    """

    force_min_n: Number = Field(default=-10.0, ge=-1000, le=0)
    force_max_n: Number = Field(default=110.0, gt=0, le=1000)
    force_rate_n_per_s: Number = Field(default=250_000.0, gt=0)
    speed_rad_per_s: tuple[Number, Number, Number] = (15.0, 40.0, 100.0)
    travel_rad: tuple[Number, Number, Number] = (0.12, 0.25, 1.2)
    return_rad: Number = Field(default=0.005, gt=0, le=1)
    baseline_n: tuple[Number, Number] = (-1.0, 1.0)
    least_preload_n: Number | None = None
    push_n: Number = Field(default=3.0, gt=0, le=120)
    no_force_s: Number = Field(default=0.005, ge=0.001, le=0.2)
    stuck_s: Number = Field(default=0.005, ge=0.001, le=0.2)


class WatchdogConfig(_Table):
    """The device's watchdog timer: outputs made safe when the program has been silent for ``timeout_s``."""

    timeout_s: Number = Field(default=0.5, ge=0.05, le=30)


class RecordingConfig(_Table):
    """Timing of a trial and what counts as rest."""

    quiet_s: Number = Field(default=0.35, ge=0.3, le=10)
    rest_s: Number = Field(default=0.2, ge=0.2, le=10)
    rest_counts: Count = Field(default=1, ge=0, le=1000)
    rest_force_n: Number = Field(default=0.2, gt=0, le=10)
    longest_s: Number = Field(default=3.0, ge=0.5, le=60)
    block_s: Number = Field(default=0.02, ge=0.001, le=1)


class RigConfig(_Table):
    """A whole rig file."""

    schema_name: Literal["piano-action-rig rig 1"] = Field(alias="schema")
    name: Text
    mains_frequency_hz: Number = Field(ge=40, le=70)
    device: DeviceConfig
    force: ForceConfig
    encoders: tuple[EncoderConfig, EncoderConfig, EncoderConfig]
    motor: MotorConfig
    camera: CameraConfig | None = None
    drive_enable: DriveEnableConfig | None = None
    watchdog: WatchdogConfig | None = None
    limits: LimitsConfig = LimitsConfig()
    recording: RecordingConfig = RecordingConfig()

    @model_validator(mode="after")
    def _consistent(self) -> RigConfig:
        names = tuple(encoder.name for encoder in self.encoders)
        if names != BODIES:
            raise ValueError(f"encoders are named {names}, allowed {BODIES} in this order")
        counters = [encoder.counter for encoder in self.encoders]
        if self.camera is not None:
            counters.append(self.camera.counter)
        # on a chassis, Mod3/ctr0 and Mod4/ctr0 are one and the same counter
        own = [counter.rsplit("/", 1)[-1].lower() for counter in counters]
        if len(set(own)) != len(own):
            raise ValueError(
                f"encoders and camera use the counters {counters}, allowed one task per counter; give each its own"
            )
        if self.watchdog is not None and self.recording.block_s > self.watchdog.timeout_s / 2:
            raise ValueError(
                f"recording.block_s = {self.recording.block_s:g} s, allowed at most half of watchdog.timeout_s = "
                f"{self.watchdog.timeout_s:g} s"
            )
        terminals = [t for encoder in self.encoders for t in (encoder.a_terminal, encoder.b_terminal)]
        if len(set(terminals)) != len(terminals):
            raise ValueError(f"encoder terminals {terminals} repeat; each signal needs its own terminal")
        return self


@dataclass(frozen=True)
class Rig:
    """A checked rig file with its text, so that a session can keep both."""

    config: RigConfig
    text: str
    sha256: str
    source: str


def built_in_rigs() -> tuple[str, ...]:
    """Return the names of the rig files that come with the package."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def load_rig(name: str | Path = "virtual") -> Rig:
    """Load a built-in rig file by name, or one by path.

    Raises
    ------
    InputError
        When the file is missing, not TOML, or holds a value outside its allowed range.
    """
    path = FOLDER / f"{name}.toml" if str(name) in built_in_rigs() else Path(name)
    if not path.is_file():
        raise InputError(
            f"{name}: no such rig file; built in are {', '.join(built_in_rigs())}, or give the path of a TOML file"
        )
    return parse_rig(toml_file.read_text(path), str(path))


def parse_rig(text: str, where: str = "rig file") -> Rig:
    """Check TOML text as a rig file; ``where`` names it in errors."""
    config = toml_file.check(RigConfig, toml_file.parse_toml(text, where), where)
    return Rig(config, text, sha256_of_bytes(text.encode("utf-8")), where)
