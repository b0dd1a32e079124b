"""``session.toml``: who recorded what, on which action, with which rig, in which room, with which software.

A value nobody measured is the word ``unknown``. The place at which a position sensor looks and the point that was
calibrated are two things: a sensor at the back of a key may be calibrated by a ruler at its front.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import ConfigDict, Field, field_validator

from rig.configuration.rig_file import CertificateConfig, ChannelConfig, EncoderConfig, RigConfig, Table

SCHEMA: Literal["piano-action-rig session 1"] = "piano-action-rig session 1"
Unknown = Literal["unknown"]
Level = Annotated[float, Field(strict=True, ge=-0.2, le=0.2)] | Unknown
Mass = Annotated[float, Field(strict=True, ge=0, le=1)] | Unknown
Digest = Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")]


class RegulationInfo(Table):
    """The action's regulation as measured on the bench, m (the quantities of ``pianorig regulate``), or ``unknown``."""

    dip_m: Level = "unknown"
    hammer_height_m: Level = "unknown"
    jack_m: Level = "unknown"
    repetition_m: Level = "unknown"
    let_off_m: Level = "unknown"
    drop_m: Level = "unknown"
    check_m: Level = "unknown"
    note: str = ""


class AddedMassInfo(Table):
    """What the sensors add to the bodies, kg: load cell at the key front, encoder scales; or ``unknown``."""

    load_cell_kg: Mass = "unknown"
    key_scale_kg: Mass = "unknown"
    whippen_scale_kg: Mass = "unknown"
    hammer_scale_kg: Mass = "unknown"
    note: str = ""


class ActionInfo(Table):
    """The action on the bench: its name, key number, measured regulation and masses added by sensors."""

    name: str = "unknown"
    key: str = "unknown"
    regulation: RegulationInfo = RegulationInfo()
    added_masses: AddedMassInfo = AddedMassInfo()

    @field_validator("regulation", "added_masses", mode="before")
    @classmethod
    def _as_note(cls, value: object) -> object:
        """A text in place of a table is its note; ``unknown`` is an empty table."""
        if isinstance(value, str):
            return {} if value in ("", "unknown") else {"note": value}
        return value


MAPPING = "mapping.toml"
"""Copy of what an imported session was made with; it stands in the place of a rig file."""


class FileInfo(Table):
    """A file the session was made with: its name, the copy kept beside it, the SHA-256 of its text."""

    name: str
    copy_name: str = ""
    sha256: Digest = ""


class PlanCondition(Table):
    """A condition of the trial plan: its name, the operator's prompt, and the copy of its profile."""

    name: str
    prompt: str = ""
    profile: FileInfo


class PlanInfo(Table):
    """What was planned; ``order`` names the condition of each entry, the first ``warm_up`` do not count."""

    trials: Annotated[int, Field(strict=True, ge=1)] = 1
    seed: Annotated[int, Field(strict=True, ge=0)] | None = None
    rest_s: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    warm_up: Annotated[int, Field(strict=True, ge=0)] = 0
    sha256: Digest = ""
    conditions: tuple[PlanCondition, ...] = ()
    order: tuple[str, ...] = ()


class RoomInfo(Table):
    """The room: each value in SI-derived units, or ``unknown``."""

    temperature_c: Annotated[float, Field(strict=True, ge=-40, le=60)] | Unknown = "unknown"
    relative_humidity_percent: Annotated[float, Field(strict=True, ge=0, le=100)] | Unknown = "unknown"


class SessionInfo(Table):
    """Contents of ``session.toml``."""

    schema_name: Literal["piano-action-rig session 1"] = Field(default=SCHEMA, alias="schema")
    name: str = ""
    kind: Literal["blows", "felt"] = "blows"
    """Blows on a key, or presses of a felt by the arm, in which the encoder is not on the key."""
    operator: str = "unknown"
    created_utc: str = ""
    simulated: Annotated[bool, Field(strict=True)]
    action: ActionInfo = ActionInfo()
    rig: FileInfo
    profile: FileInfo
    plan: PlanInfo = PlanInfo()
    room: RoomInfo = RoomInfo()
    backend: dict[str, str] = {}
    software: dict[str, str] = {}
    notes: dict[str, str] = {}
    dry_run: dict[str, float | str] = {}
    """What the model predicted of the profile before it was played."""

    model_config = ConfigDict(populate_by_name=True)

    def to_table(self) -> dict[str, Any]:
        """Return nested plain values, ready for TOML."""
        return self.model_dump(by_alias=True)


@dataclass(frozen=True)
class RulerInfo:
    """Ruler points of a position sensor."""

    body: str  # the body whose displacement it is
    sensor_at: str  # where the sensor looks
    calibrated_at: str  # the point whose displacement the ruler gave; positive as the key is pressed
    reading: tuple[float, ...]  # readings at the points, in the unit of the channel
    displacement_m: tuple[float, ...]  # displacement at the points, m, rising
    u_displacement_m: float = 0.0  # standard uncertainty of a reading of the ruler, m
    u_reading: float = 0.0  # standard uncertainty of ``reading`` (rounding and drift), in the unit of the channel


PASSIVE = "passive"
"""Name of the profile of what somebody played, and of the settings of its strokes in a trial's provenance."""
KEY_OPPOSITE = "key_opposite_rad"
"""Channel of a second reading head on the key's scale."""


Info = TypeVar("Info")


def take_same_fields(kind: type[Info], config: Table, **own: Any) -> Info:
    names = {one.name for one in fields(kind)} - own.keys()  # type: ignore[arg-type]
    return kind(**{name: getattr(config, name) for name in names if hasattr(config, name)}, **own)


def restore_info(kind: type[Info], plain: Mapping[str, Any]) -> Info:
    """Return a record from JSON, which has lists for tuples."""
    return kind(**{key: tuple(value) if isinstance(value, list) else value for key, value in plain.items()})


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
    def from_config(cls, config: EncoderConfig) -> EncoderInfo:
        """Return what the rig file says of an encoder."""
        return take_same_fields(cls, config, channel=config.counter, calibration=_calibration("", config.certificate))

    of = from_config  # its former name, for one release

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
    mains_frequency_hz: float = 60.0  # choice: the bench of the thesis, in Canada
    device_scaling: tuple[float, ...] = ()
    """Polynomial from the converter's code to the reading in V or V/V, by the driver; empty where it is not known."""

    @property
    def volts_per_unit(self) -> float:
        """V, or V/V, per unit of the electrical reading."""
        return 1e-3 if self.electrical_unit == "mV/V" else 1.0

    @classmethod
    def from_config(cls, config: RigConfig, group_delay_s: float) -> ForceInfo:
        """Description of the force channel for a trial's file: what the rig file says of it, with ``group_delay_s``,
        the delay that the device itself states, in place of the rig file's."""
        return take_same_fields(
            cls,
            config.force,
            calibration=_calibration(config.force.calibration, config.force.certificate),
            group_delay_s=group_delay_s,
            mains_frequency_hz=config.mains_frequency_hz,
        )

    of = from_config  # its former name, for one release


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
    def from_config(cls, config: ChannelConfig) -> ChannelInfo:
        """Return what the rig file says of a further channel."""
        ruler = None if config.ruler is None else RulerInfo(**config.ruler.model_dump())
        calibration = _calibration(config.calibration, config.certificate)
        return take_same_fields(cls, config, calibration=calibration, ruler=ruler)

    of = from_config  # its former name, for one release

    @classmethod
    def opposite_head(cls, config: RigConfig) -> ChannelInfo:
        """Description, as of a further channel, of the second reading head on the key's scale: angle, rad, positive
        counter-clockwise, from counts; the rig file must have one (`key_opposite`)."""
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
        """Restore it from JSON; older files have no ruler."""
        ruler = plain.get("ruler")
        return restore_info(cls, {**plain, "ruler": None if ruler is None else restore_info(RulerInfo, ruler)})
