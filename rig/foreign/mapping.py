"""The mapping file of an import: which channel of a foreign recording is what, in which unit and scale (TOML)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from rig.configuration import toml_file
from rig.configuration.rig_file import BODIES, RESERVED_NAMES, LimitsConfig, Number, RulerConfig, Table, Text
from rig.errors import RigInputError, refuse
from rig.foreign.channel_table import ChannelTable, known_unit
from rig.session.info import ActionInfo, RoomInfo


class PositionMapping(Table):
    """A position sensor: reading = (value - ``offset``) / ``gain``, with ruler points for the reading.

    ``limits`` are the converter's ends in the channel's own unit: a value that stays there is a saturated sensor.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
    channel: Text
    unit: Text = "1"
    offset: Number = 0.0
    gain: Number = 1.0
    limits: tuple[Number, Number] | None = None
    sensor: str = "unknown"
    group_delay_s: Number = Field(default=0.0, ge=0, le=1)
    u_noise: Number = Field(default=0.0, ge=0)
    """Standard deviation of a reading's noise (after offset and gain)."""
    ruler: RulerConfig

    @model_validator(mode="after")
    def _check_gain_and_limits(self) -> PositionMapping:
        """Refuse a gain of 0, limits in the wrong order, and a name that every trial uses already."""
        refuse(
            ValueError,
            (self.gain == 0, f"positions.{self.name}: gain = 0, allowed anything else"),
            (
                self.limits is not None and not self.limits[0] < self.limits[1],
                f"positions.{self.name}: limits {self.limits}, allowed a lower and a higher value",
            ),
            (self.name in RESERVED_NAMES, f"positions.{self.name}: this name is taken by every trial"),
        )
        return self


class EpisodeMapping(Table):
    """A stretch of the recording, s by its own clock: what was played there, or why its strokes do not count."""

    from_s: Number
    to_s: Number
    file: str = ""
    """Name of the recording it belongs to, without ``.gz``; empty for any. Another one's seconds mean other strokes."""
    condition: str = ""
    reject: str = ""

    @model_validator(mode="after")
    def _check_order(self) -> EpisodeMapping:
        if not self.from_s < self.to_s:
            raise ValueError(f"episodes: from_s = {self.from_s:g}, allowed below to_s = {self.to_s:g}")
        return self


class StrokesMapping(Table):
    """What a stroke is in a recording of positions.

    A stroke begins when any position leaves its resting level by ``trigger`` (a share of its ruler) and ends when all
    have been back within it for ``rest_s``. ``pre_s`` before and ``rest_s`` after belong to the trial.
    """

    trigger: Number = Field(default=0.15, gt=0, lt=1)  # of the ruler: choice, above noise and play
    pre_s: Number = Field(default=0.3, gt=0, le=10)  # 15 periods of 50 Hz
    rest_s: Number = Field(default=0.12, gt=0, le=10)  # choice: a rebound is shorter
    episodes: tuple[EpisodeMapping, ...] = ()


NEWTONS = {"N": 1.0, "mN": 1e-3, "kN": 1e3, "lbf": 4.4482216152605, "kgf": 9.80665, "gf": 9.80665e-3}


class TimeMapping(Table):
    """The sample clock: a channel of times or its rate; neither where the file states its interval.

    ``same_start`` says that the channels began together although the file states different starts.
    """

    channel: Text | None = None
    unit: Literal["s", "ms", "us", "ns"] = "s"
    sample_rate_hz: Annotated[float, Field(strict=True, gt=0, le=1e7, allow_inf_nan=False)] | None = None
    same_start: bool = Field(default=False, strict=True)
    ignore: tuple[Text, ...] = ()
    """Columns of times that are not the sample clock's, and properties with a wrong rate: not compared with it."""

    @model_validator(mode="after")
    def _check_one_source(self) -> TimeMapping:
        if self.channel is not None and self.sample_rate_hz is not None:
            raise ValueError("time.channel and time.sample_rate_hz: allowed is one of them")
        return self


class ForceMapping(Table):
    """The load cell: force = (value - ``zero``) · ``newtons_per_unit``, positive downwards on the key."""

    channel: Text
    unit: Literal["N", "mN", "kN", "lbf", "kgf", "gf", "V", "mV", "mV/V"] = "N"
    newtons_per_unit: Number | None = None
    zero: Number = 0.0
    sensor: str = "unknown"
    calibration: str = "unknown"
    group_delay_s: Number = Field(default=0.0, ge=0, le=1)
    u_group_delay_s: Number = Field(default=0.0, ge=0, le=1)
    u_noise_n: Number = Field(default=0.0, ge=0, le=100)
    u_gain_relative: Number = Field(default=0.0, ge=0, le=1)
    preload_n: Number = Field(default=0.0, ge=0, le=10)
    u_preload_n: Number = Field(default=0.0, ge=0, le=10)

    @property
    def scale(self) -> float:
        """Newtons per unit."""
        return NEWTONS[self.unit] if self.newtons_per_unit is None else self.newtons_per_unit

    @model_validator(mode="after")
    def _check_scale(self) -> ForceMapping:
        """Refuse a scale of 0, and a missing one where the unit is none of force."""
        refuse(
            ValueError,
            (
                self.newtons_per_unit is None and self.unit not in NEWTONS,
                f"force.newtons_per_unit is missing; a force in {self.unit} needs it",
            ),
            (self.newtons_per_unit == 0, "force.newtons_per_unit = 0, allowed anything else"),
        )
        return self


class EncoderMapping(Table):
    """An encoder: ``sign`` +1 when the value rises as the body turns counter-clockwise (thesis Fig. 2.3), else -1.

    ``counter_bits`` is the width of the counter whose wraps the recording holds.
    """

    name: Literal["key", "whippen", "hammer"]
    channel: Text
    unit: Literal["counts", "rad", "deg"]
    counts_per_revolution: Annotated[int, Field(strict=True, ge=16, le=2**31)]
    sign: Literal[1, -1]
    counter_bits: Annotated[int, Field(strict=True, ge=8, le=52)] | None = None
    u_scale_relative: Number = Field(default=0.0, ge=0, le=0.5)

    @model_validator(mode="after")
    def _check_counter_bits(self) -> EncoderMapping:
        if self.counter_bits is not None and self.unit != "counts":
            raise ValueError(f"encoders.{self.name}.counter_bits: allowed with unit = 'counts', found {self.unit!r}")
        return self


class MotorMapping(Table):
    """The motor command, where it was recorded."""

    channel: Text
    volts_per_unit: Number = 1.0


class ImportMapping(Table):
    """A whole mapping file.

    Attributes
    ----------
    force : None for a recording of ``positions`` alone, which is cut into ``strokes``
    absent_encoders : bodies that were not measured; with those of ``encoders`` they are all three
    segments : "trials", "join" or None; meaning of a file's segments: one trial each, or parts of one. None refuses
        files of several.
    separator, decimal, thousands : of CSV; ``thousands``, between groups of three digits, is empty for none, and a
        space also stands for no-break and thin ones. The separator may be the decimal sign as well where cells are
        quoted.
    names_row, skip_rows : line of the names in CSV, from 1, or how many lines before it are left out
    limits : force and speeds beyond which a recording is doubtful
    utc_offset_h : zone of the times of day in the files, hours ahead of UTC; None where it is not known
    overrule_units : channels whose unit, or a scale that is not known here, the file states wrongly: the mapping's is
        taken
    time.ignore : columns of times that are not the sample clock's, and properties of the file that state a wrong rate
    """

    schema_name: Literal["piano-action-rig mapping 1"] = Field(alias="schema")
    simulated: bool = Field(strict=True)
    operator: str = "unknown"
    separator: Literal[",", ";", "\t", " "] = ","
    decimal: Literal[".", ","] = "."
    thousands: Literal["", ".", ",", " ", "'"] = ""
    names_row: Annotated[int, Field(strict=True, ge=1, le=10_000)] | None = None
    skip_rows: Annotated[int, Field(strict=True, ge=0, le=10_000)] = 0
    utc_offset_h: Number | None = Field(default=None, ge=-14, le=14)
    mains_frequency_hz: Number = Field(ge=40, le=70)
    blow_start_s: Number | None = Field(default=None, ge=0)
    time: TimeMapping = TimeMapping()
    force: ForceMapping | None = None
    positions: tuple[PositionMapping, ...] = ()
    strokes: StrokesMapping = StrokesMapping()
    encoders: Annotated[tuple[EncoderMapping, ...], Field(max_length=3)] = ()
    absent_encoders: tuple[Literal["key", "whippen", "hammer"], ...] = ()
    segments: Literal["trials", "join"] | None = None
    overrule_units: tuple[Text, ...] = ()
    motor: MotorMapping | None = None
    limits: LimitsConfig = LimitsConfig()
    action: ActionInfo = ActionInfo()
    room: RoomInfo = RoomInfo()

    @model_validator(mode="after")
    def _check_consistency(self) -> ImportMapping:
        """Refuse tables that contradict each other: force beside positions, a body or channel twice or missing, names
        of channels that are not mapped, one sign for decimals and thousands."""
        names, channels = tuple(encoder.name for encoder in self.encoders), self.channels
        positions = [one.name for one in self.positions]
        both = [body for body in names if body in self.absent_encoders]
        unsaid = [body for body in BODIES if body not in (*names, *self.absent_encoders)]
        unknown = [name for name in self.overrule_units if name not in (*channels, self.time.channel)]
        refuse(
            ValueError,
            (
                names != tuple(body for body in BODIES if body in names) or len(set(names)) != len(names),
                f"encoders are named {names}, allowed once each, in this order: {BODIES}",
            ),
            (
                (self.force is None) != bool(positions),
                "allowed is [force] with encoders, or [[positions]] without a force; the mapping has "
                + ("both" if positions else "neither"),
            ),
            (
                positions and (self.encoders or self.absent_encoders or self.motor),
                "[[positions]]: encoders, absent_encoders and motor belong to a mapping with [force]",
            ),
            (len(set(positions)) != len(positions), f"positions are named {positions}, allowed once each"),
            (both, f"absent_encoders names {', '.join(both)}, which is under encoders as well"),
            (
                unsaid and self.force is not None,
                f"encoders: {', '.join(unsaid[:1])} is missing; add it, or say absent_encoders = {unsaid} where it was "
                "not measured",
            ),
            (
                len(set(channels)) != len(channels),
                f"channels {channels} repeat; each quantity has a channel of its own",
            ),
            (self.time.channel in channels, f"time.channel = {self.time.channel!r} is a measured channel as well"),
            (unknown, f"overrule_units names {', '.join(map(repr, unknown))}, allowed are the channels of the mapping"),
            (self.names_row and self.skip_rows, "names_row and skip_rows: allowed is one of them"),
            (self.thousands == self.decimal, f"thousands = {self.thousands!r} is the decimal sign as well"),
        )
        return self

    @property
    def channels(self) -> list[str]:
        """Measured channels, force first."""
        if self.force is None:
            return [one.channel for one in self.positions]
        encoders = [encoder.channel for encoder in self.encoders]
        return [self.force.channel, *encoders, *([self.motor.channel] if self.motor else [])]


@dataclass(frozen=True)
class MappingFile:
    """A checked mapping with its text."""

    config: ImportMapping
    text: str
    where: str


def load_mapping(path: str | Path) -> MappingFile:
    """Read and check a mapping file (TOML), which tells an import which channel of a recording is what; RigInputError
    for a missing file or a value that is not allowed.

    Parameters
    ----------
    path : path
        TOML file, see ``docs/import.md``.

    Returns
    -------
    MappingFile

    Raises
    ------
    RigInputError
        When the file is missing, not TOML, or has a value that is not allowed.

    Examples
    --------
    >>> import rig
    >>> [encoder.name for encoder in rig.load_mapping("lab.toml").config.encoders]
    ['key', 'whippen', 'hammer']
    """
    return parse_mapping(toml_file.read_text(Path(path)), str(path))


def parse_mapping(text: str, where: str = "mapping") -> MappingFile:
    toml_file.refuse_nul(text, where)
    return MappingFile(toml_file.check(ImportMapping, toml_file.parse_toml(text, where), where), text, where)


def check_unit(table: ChannelTable, channel: str, unit: str, overruled: tuple[str, ...] = ()) -> None:
    """Refuse (RigInputError) a channel for which the file states another unit than ``unit``, one of ours, unless the
    channel is in ``overruled``; one without a stated unit passes."""
    stated = table.units.get(channel, "").strip()
    if known_unit(stated) not in (None, unit) and channel not in overruled:
        raise RigInputError(
            f"{table.where}: {channel} is in {stated!r} by the file itself, the mapping says {unit!r}; correct the "
            "mapping, or name the channel in overrule_units where the file is wrong"
        )
