"""The rig file: which device, channels, scales, signs and limits the bench has (TOML, checked, frozen).

It is read before anything else; its text and SHA-256 go into every session. Conventions as in
:mod:`rig.configuration.channels`. ``[[devices]]`` are cards or chassis beside the one whose AI clock everything
follows; ``[felt]`` says how the arm presses a felt, what gives way between them, and what is allowed.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from rig.configuration import toml_file
from rig.configuration.channels import (
    BODIES,
    ArmConfig,
    CameraConfig,
    ChannelConfig,
    Count,
    DeviceConfig,
    DriveEnableConfig,
    EncoderConfig,
    ForceConfig,
    MotorConfig,
    Number,
    OppositeHeadConfig,
    Table,
    Text,
)
from rig.storage.atomic_write import sha256_of_bytes


class FeltConfig(Table):
    """The arm as a press for felts (``pianorig record --felt``).

    The scale of ``encoder`` is mounted on the motor's shaft for this. ``compliance_m_per_n`` is that of arm and load
    cell between shaft and felt; ``record --felt block`` measures it. Beyond ``force_limit_n`` or ``depth_limit_m`` the
    press ends at once.
    """

    encoder: Literal["key", "whippen", "hammer"] = "key"
    radius_m: Number = Field(gt=0, le=1)
    """From the shaft to where the felt is touched."""
    u_radius_m: Number = Field(default=1e-4, ge=0, le=0.01)
    compliance_m_per_n: Number = Field(ge=0, le=1e-3)
    u_compliance_m_per_n: Number = Field(ge=0, le=1e-3)
    force_limit_n: Number = Field(default=50.0, gt=0, le=120)
    depth_limit_m: Number = Field(default=3e-3, gt=0, le=0.02)


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
    def _wired(self) -> FurtherDevice:
        wires = [self.clock_from, self.clock_to]
        if self.link == "lines" and None in wires:
            raise ValueError(f"{self.name}: link = 'lines' needs clock_from and clock_to, the ends of the wire")
        if self.link == "RTSI" and wires != [None, None]:
            raise ValueError(f"{self.name}: link = 'RTSI' has no clock_from and clock_to; the driver finds the lines")
        if self.link == "RTSI" and self.product.startswith("cDAQ"):
            raise ValueError(f"{self.name}: a {self.product} has no RTSI; allowed link = 'lines'")
        return self

    def owns(self, channel: str) -> bool:
        """Whether a channel or terminal is this device's, or one of its modules'."""
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


class WatchdogConfig(Table):
    """The device's watchdog timer: outputs made safe when the program has not reset it for ``timeout_s``."""

    timeout_s: Number = Field(default=0.5, ge=0.05, le=30)


class SafetyConfig(Table):
    """Who may let the motor move: ``--yes`` instead of a typed confirmation, and how old a self-test may be."""

    allow_yes: bool = Field(default=False, strict=True)
    selftest_valid_h: Number = Field(default=24.0, gt=0, le=8760)


class SelftestConfig(Table):
    """What ``pianorig selftest`` expects of a sound bench.

    ``stroke_rad`` is how far key, whippen and hammer turn, counter-clockwise positive, when the key is pressed to its
    bottom by hand. ``push_n`` must not move the key. ``shunt_ohm`` is the module's shunt resistor, 0 for none.
    """

    stroke_rad: tuple[Number, Number, Number]
    stroke_tolerance: Number = Field(default=0.15, gt=0, le=0.4)
    push_n: Number = Field(default=0.25, gt=0, le=5)
    push_tolerance: Number = Field(default=0.2, gt=0, le=0.5)
    latency_tolerance_samples: Number = Field(default=0.5, gt=0, le=100)
    drive_delay_s: Number = Field(default=0.0, ge=0, le=0.01)
    """From the analog output to the torque."""
    offset_limit_n: Number = Field(default=2.0, gt=0, le=100)
    shunt_ohm: Number = Field(default=100e3, ge=0)
    shunt_tolerance: Number = Field(default=0.02, gt=0, le=0.5)
    loopback: Text | None = None
    """A voltage input that is wired to the motor's output, if there is one."""


class RecordingConfig(Table):
    """Timing of a trial and what counts as rest."""

    quiet_s: Number = Field(default=0.35, ge=0.3, le=10)
    rest_s: Number = Field(default=0.2, ge=0.2, le=10)
    rest_counts: Count = Field(default=1, ge=0, le=1000)
    rest_force_n: Number = Field(default=0.2, gt=0, le=10)
    longest_s: Number = Field(default=3.0, ge=0.5, le=900)
    block_s: Number = Field(default=0.02, ge=0.001, le=1)


class PassiveConfig(Table):
    """What a stroke of a player is (``record --passive``): when it begins and ends.

    ``pre_s`` of quiet time is kept before it. Force or key must leave their level by ``trigger_n`` or ``trigger_rad``;
    encoders are still within ``still_rad``; ``longest_s`` ends a stroke whose key is held.
    """

    pre_s: Number = Field(default=0.5, ge=0.3, le=10)
    trigger_n: Number = Field(default=0.5, gt=0, le=20)
    trigger_rad: Number = Field(default=0.002, gt=0, le=0.1)
    still_rad: Number = Field(default=5e-4, gt=0, le=0.1)
    longest_s: Number = Field(default=10.0, ge=0.5, le=900)


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
    def _consistent(self) -> RigConfig:
        names = tuple(encoder.name for encoder in self.encoders)
        if names != BODIES:
            raise ValueError(f"encoders are named {names}, allowed {BODIES} in this order")
        heads: list[EncoderConfig | OppositeHeadConfig] = [*self.encoders]
        heads += [self.key_opposite] if self.key_opposite is not None else []
        counters = [head.counter for head in heads]
        if self.camera is not None:
            counters.append(self.camera.counter)
        # on a chassis, Mod3/ctr0 and Mod4/ctr0 are the same counter
        own = [(self.device_of(counter), counter.rsplit("/", 1)[-1].lower()) for counter in counters]
        if len(set(own)) != len(own):
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
        if self.watchdog is not None and not reach:
            raise ValueError(
                f"watchdog: neither motor.channel nor drive_enable.line is on {self.device.name}, whose watchdog it "
                "is; allowed with one of them there, or no [watchdog]"
            )
        if self.watchdog is not None and self.recording.block_s > self.watchdog.timeout_s / 2:
            raise ValueError(
                f"recording.block_s = {self.recording.block_s:g} s, allowed at most half of watchdog.timeout_s = "
                f"{self.watchdog.timeout_s:g} s"
            )
        terminals = [t for head in heads for t in (head.a_terminal, head.b_terminal)]
        if len(set(terminals)) != len(terminals):
            raise ValueError(f"encoder terminals {terminals} repeat; each signal needs its own terminal")
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
        names = [self.device.name.lower(), *(further.name.lower() for further in self.devices)]
        if len(set(names)) != len(names):
            raise ValueError(f"devices are named {names}; each needs a name of its own")
        if any(further.link == "RTSI" for further in self.devices) and self.device.product.startswith("cDAQ"):
            raise ValueError(f"device.product = {self.device.product}: has no RTSI; allowed link = 'lines'")
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
            if further.clock_to is not None and not further.owns(further.clock_to):
                raise ValueError(f"{further.name}: clock_to = {further.clock_to}, allowed a terminal of {further.name}")
            if further.clock_from is not None and self.device_of(further.clock_from) is not None:
                raise ValueError(
                    f"{further.name}: clock_from = {further.clock_from}, allowed a terminal of {self.device.name}"
                )

    def _check_channels(self) -> None:
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
    """Load a built-in rig file by name, or one by path.

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
    path = toml_file.named(name, FOLDER, "rig file")
    return parse_rig(toml_file.read_text(path), str(path))


def parse_rig(text: str, where: str = "rig file") -> Rig:
    """Check TOML text as a rig file.

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
    config = toml_file.check(RigConfig, toml_file.parse_toml(text, where), where)
    return Rig(config, text, sha256_of_bytes(text.encode("utf-8")), where)
