"""One trial in memory: the arrays on the DAQ clock and what is needed to interpret them.

Conventions: force positive downwards on the key, calibrated but not corrected for offset, channel delay or
mains hum; encoder counts as integers exactly as the counters gave them; angles counter-clockwise, zero at the
first sample.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.configuration.channels import BODIES, CertificateConfig, ChannelConfig, EncoderConfig, Table
from rig.configuration.rig_file import RigConfig
from rig.errors import RigInputError
from rig.session.ruler_info import RulerInfo

if TYPE_CHECKING:
    import pandas as pd

    from rig.session.ruler import Position


KEY_OPPOSITE = "key_opposite_rad"
"""Channel of a second reading head on the key's scale."""


def absent_bodies(names: Iterable[str]) -> tuple[str, ...]:
    """Return the bodies that no encoder of ``names`` reads."""
    present = set(names)
    return tuple(body for body in BODIES if body not in present)


def of_same_name(info: type, config: Table) -> dict[str, Any]:
    """Return the values of a configuration table for which the record has fields of the same name."""
    return {one.name: getattr(config, one.name) for one in fields(info) if hasattr(config, one.name)}


def _calibration(text: str, certificate: CertificateConfig | None) -> str:
    return "; ".join(filter(None, (text, str(certificate or ""))))


@dataclass(frozen=True)
class EncoderInfo:
    """One angular encoder: which body, its scale and the sense of its counts.

    ``sign`` is +1 when the count rises as the body turns counter-clockwise, -1 otherwise;
    ``counts_per_revolution`` counts all four edges (X4). Standard uncertainties: ``u_scale_relative`` of the scale,
    ``u_interpolation_rad`` of the divided line signal, ``u_eccentricity_rad`` of a scale off its centre (rad per rad
    turned), ``u_pivot_shift_rad`` of a pivot that moves in its bushing. ``calibration`` names the certificate.
    """

    name: str
    counts_per_revolution: int
    sign: int = 1
    channel: str = ""
    u_scale_relative: float = 0.0
    u_interpolation_rad: float = 0.0
    u_eccentricity_rad: float = 0.0
    u_pivot_shift_rad: float = 0.0
    calibration: str = ""
    arc_gain: float = 1.0
    """True angle over reading, over the arc the body turns."""

    @classmethod
    def of(cls, config: EncoderConfig) -> EncoderInfo:
        """Return what the rig file says of an encoder."""
        own = {"channel": config.counter, "calibration": _calibration("", config.certificate)}
        return cls(**{**of_same_name(cls, config), **own})

    @property
    def u_turn_relative(self) -> float:
        """Standard uncertainty of an angle per angle turned: scale and eccentricity."""
        return float(np.hypot(self.u_scale_relative, self.u_eccentricity_rad))

    @property
    def u_change_rad(self) -> float:
        """Standard uncertainty of the difference of two readings that does not grow with it, without quantisation.

        Interpolation enters at both readings, the shift of the pivot once.
        """
        return float(np.hypot(np.sqrt(2.0) * self.u_interpolation_rad, self.u_pivot_shift_rad))

    @property
    def rad_per_count(self) -> float:
        """Signed angle of one count, rad."""
        return self.sign * 2.0 * np.pi / self.counts_per_revolution * self.arc_gain


@dataclass(frozen=True)
class ForceInfo:
    """The force channel: calibration, delay, preload and standard uncertainties (k = 1).

    Calibration is the straight line through ``electrical`` (in ``electrical_unit``) and ``physical_n``. The
    force of sample k was felt ``group_delay_s`` before the time of sample k.
    """

    sensor: str
    calibration: str
    electrical: tuple[float, float]
    physical_n: tuple[float, float]
    electrical_unit: str = "mV/V"
    channel: str = ""
    excitation_v: float = 0.0
    group_delay_s: float = 0.0
    u_group_delay_s: float = 0.0
    u_noise_n: float = 0.0
    u_gain_relative: float = 0.0
    preload_n: float = 0.0
    u_preload_n: float = 0.0
    mains_frequency_hz: float = 60.0
    device_scaling: tuple[float, ...] = ()
    """Polynomial from the converter's code to the reading in V or V/V, by the driver; empty where it is not known."""

    @property
    def volts_per_unit(self) -> float:
        """V, or V/V, per unit of the electrical reading."""
        return 1e-3 if self.electrical_unit == "mV/V" else 1.0

    @classmethod
    def of(cls, config: RigConfig, group_delay_s: float) -> ForceInfo:
        """Return what the rig file says of the force channel, with the delay the device really has, s."""
        own = {
            "calibration": _calibration(config.force.calibration, config.force.certificate),
            "group_delay_s": group_delay_s,
            "mains_frequency_hz": config.mains_frequency_hz,
        }
        return cls(**{**of_same_name(cls, config.force), **own})


NO_FORCE = ForceInfo(sensor="not recorded", calibration="none", electrical=(0.0, 1.0), physical_n=(0.0, 1.0))
"""Of a trial without a force channel."""


@dataclass(frozen=True)
class ChannelInfo:
    """A further analog channel: what it measures in which unit, its calibration, delay and standard uncertainties.

    The value recorded lies on the straight line through ``electrical`` (V) and ``physical`` (``unit``); that of sample
    k was there ``group_delay_s`` before the time of sample k. ``u_noise`` is in ``unit``.
    """

    name: str
    quantity: str
    unit: str
    sensor: str
    calibration: str
    electrical: tuple[float, float]
    physical: tuple[float, float]
    channel: str = ""
    group_delay_s: float = 0.0
    u_noise: float = 0.0
    u_gain_relative: float = 0.0
    ruler: RulerInfo | None = None
    """Ruler points of a position sensor, whose readings are the channel's values; None for any other channel."""

    @classmethod
    def of(cls, config: ChannelConfig) -> ChannelInfo:
        """Return what the rig file says of a further channel."""
        ruler = None if config.ruler is None else RulerInfo(**config.ruler.model_dump())
        own = {"calibration": _calibration(config.calibration, config.certificate), "ruler": ruler}
        return cls(**{**of_same_name(cls, config), **own})

    @classmethod
    def opposite_head(cls, config: RigConfig) -> ChannelInfo:
        """Return what the rig file says of the second reading head on the key's scale: its angle, counter-clockwise."""
        head, key = config.key_opposite, config.encoders[0]
        assert head is not None
        turn = 2.0 * np.pi * head.sign
        return cls(
            name=KEY_OPPOSITE,
            quantity="angle of the key, head opposite the first",
            unit="rad",
            sensor=f"scale radius {head.scale_radius_m:.9g} m, u {head.u_scale_radius_m:.3g} m",
            calibration=_calibration(f"{key.counts_per_revolution} counts per revolution", key.certificate),
            electrical=(0.0, float(key.counts_per_revolution)),
            physical=(0.0, turn),
            channel=head.counter,
            u_noise=float(np.hypot(2.0 * np.pi / key.counts_per_revolution / np.sqrt(12.0), key.u_interpolation_rad)),
            u_gain_relative=key.u_scale_relative,
        )

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> ChannelInfo:
        """Restore it from JSON, which has lists for pairs; older files have no ruler."""
        pairs = {key: tuple(plain[key]) for key in ("electrical", "physical")}
        ruler = plain.get("ruler")
        return cls(**{**plain, **pairs, "ruler": None if ruler is None else RulerInfo.from_plain(ruler)})


@dataclass(frozen=True)
class CameraInfo:
    """Frame clock of the camera on the DAQ's time axis.

    ``first_frame_time_s`` is the middle of the first exposure (time zero: AI start trigger); frame k follows
    ``k / frame_rate_hz`` later. ``u_time_s`` is the standard uncertainty of that tie.
    """

    frame_rate_hz: float
    first_frame_time_s: float
    exposure_s: float
    n_frames: int
    u_time_s: float

    @property
    def frame_time_s(self) -> NDArray[np.float64]:
        """Middle of each exposure, s, shape (n_frames,)."""
        return self.first_frame_time_s + np.arange(self.n_frames) / self.frame_rate_hz


@dataclass(frozen=True, eq=False)
class TrialData:
    """One recorded trial.

    Attributes
    ----------
    number : int
        Trial number, from 1.
    status : str
        ``complete``, ``not at rest``, ``interrupted``, ``fault`` (bench or disk), ``defect`` (an error in a program) or
        ``incomplete`` (recovered from the journal).
    reason : str
        Why the status is not ``complete``; empty otherwise.
    time_s : ndarray, shape (n,)
        Sample times since the AI start trigger, s.
    force_n : ndarray, shape (n,)
        Calibrated force, N, not corrected for offset, delay or hum; NaN where none was recorded.
    force_raw : ndarray, shape (n,)
        Electrical reading of the force channel, in ``force_info.electrical_unit``.
    motor_command_v : ndarray, shape (n,)
        Volts held from each sample to the next, V.
    encoder_count : ndarray of int64, shape (n, encoders)
        Counts of key, whippen and hammer since arming; an imported trial may lack some of them.
    condition : str
        Condition of the trial plan; empty without one.
    plan_entry : int
        Number of the plan's entry that was played; 0 without a plan.
    channels : tuple of ChannelInfo
        Further channels of the rig file, as many as there are.
    channel_values : ndarray, shape (n, channels), or None
        Their values, each in its unit; None without such channels.
    provenance : mapping of str
        Operator, action, rig, devices with serial numbers, calibration dates, software; empty for older files.
    """

    number: int
    status: str
    started_utc: str
    simulated: bool
    sample_rate_hz: float
    time_s: NDArray[np.float64]
    force_n: NDArray[np.float64]
    force_raw: NDArray[np.float64]
    motor_command_v: NDArray[np.float64]
    encoder_count: NDArray[np.int64]
    encoders: tuple[EncoderInfo, ...]
    force_info: ForceInfo
    camera: CameraInfo | None = None
    reason: str = ""
    blow_start_s: float = 0.0
    condition: str = ""
    plan_entry: int = 0
    sha256: str = ""
    channels: tuple[ChannelInfo, ...] = ()
    channel_values: NDArray[np.float64] | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)

    @property
    def has_force(self) -> bool:
        """Whether a force was recorded; without one its arrays are NaN and the file has none."""
        return self.force_info != NO_FORCE

    @property
    def position_names(self) -> tuple[str, ...]:
        """Channels that are position sensors."""
        return tuple(channel.name for channel in self.channels if channel.ruler is not None)

    def position(self, name: str, zero: float = 0.0) -> Position:
        """Return the displacement of position sensor ``name``; ``zero`` is what its reading has drifted by."""
        from rig.session.ruler import position_of  # start-up: scipy.interpolate costs 0.2 s, most trials have no ruler

        for k, one in enumerate(self.channels):
            if one.name == name and one.ruler is not None and self.channel_values is not None:
                reading, felt_s = self.channel_values[:, k] - zero, self.time_s - one.group_delay_s
                return position_of(name, one.ruler, felt_s, reading, one.u_noise)
        there = self.position_names or "none"
        raise RigInputError(f"trial {self.number}: no position sensor {name!r}; found {there}")

    @property
    def absent(self) -> tuple[str, ...]:
        """Bodies whose encoder was not recorded, in the usual order."""
        return absent_bodies(encoder.name for encoder in self.encoders)

    @property
    def n_valid(self) -> int:
        """Number of samples, all of them valid and without a gap."""
        return int(self.time_s.shape[0])

    def to_table(self) -> pd.DataFrame:
        """Return the trial as a table: time, force, command, counts and angle of each encoder, further channels."""
        import pandas as pd  # start-up: pandas costs 0.4 s, reading a trial does not need it

        columns: dict[str, NDArray[Any]] = {"time_s": self.time_s, "force_n": self.force_n}
        columns |= {"force_raw": self.force_raw, "motor_command_v": self.motor_command_v}
        angle_rad = self.angle_rad()
        for index, encoder in enumerate(self.encoders):
            columns[f"{encoder.name}_count"] = self.encoder_count[:, index]
            columns[f"{encoder.name}_rad"] = angle_rad[:, index]
        if self.channel_values is not None:
            columns |= {channel.name: self.channel_values[:, k] for k, channel in enumerate(self.channels)}
        return pd.DataFrame(columns)

    def angle_rad(self, zero: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """Return the encoder angles, rad, counter-clockwise, shape (n, encoders), zero at the first sample.

        ``zero`` (1, encoders): other counts at which the angles are zero.
        """
        per_count = np.array([encoder.rad_per_count for encoder in self.encoders])
        return (self.encoder_count - (self.encoder_count[:1] if zero is None else zero)) * per_count
