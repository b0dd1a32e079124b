"""What is needed to interpret the channels of a trial: encoders, the force, further channels, position sensors.

Calibrations, delays and standard uncertainties as they were when the trial was recorded. In: tables of the rig file.
Out: frozen records that travel in the file of the trial. The place at which a position sensor looks and the point that
was calibrated are two things: a sensor at the back of a key may be calibrated by a ruler at its front. The displacement
is always that of the calibrated point.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from rig.configuration.channels import CertificateConfig, ChannelConfig, EncoderConfig, Table
from rig.configuration.rig_file import RigConfig


@dataclass(frozen=True)
class RulerInfo:
    """Ruler points of a position sensor.

    Attributes
    ----------
    body : str
        The body whose displacement it is.
    sensor_at : str
        Where the sensor looks.
    calibrated_at : str
        The point whose displacement the ruler gave; positive as the key is pressed.
    reading : tuple of float
        Readings at the points, in the unit of the channel.
    displacement_m : tuple of float
        Displacement at the points, m, rising.
    u_displacement_m : float
        Standard uncertainty of a reading of the ruler, m.
    u_reading : float
        Standard uncertainty of ``reading`` (rounding and drift), in the unit of the channel.
    """

    body: str
    sensor_at: str
    calibrated_at: str
    reading: tuple[float, ...]
    displacement_m: tuple[float, ...]
    u_displacement_m: float = 0.0
    u_reading: float = 0.0

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> RulerInfo:
        """Restore it from JSON, which has lists for tuples."""
        return cls(**{**plain, **{key: tuple(plain[key]) for key in ("reading", "displacement_m")}})


KEY_OPPOSITE = "key_opposite_rad"
"""Channel of a second reading head on the key's scale."""


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
