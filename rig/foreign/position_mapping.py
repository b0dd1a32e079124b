"""Tables of a mapping file for position sensors: their calibration, and how a long recording is cut into strokes."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from rig.configuration.channels import RESERVED_NAMES, Number, RulerConfig, Table, Text


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
    def _usable(self) -> PositionMapping:
        if self.gain == 0:
            raise ValueError(f"positions.{self.name}: gain = 0, allowed anything else")
        if self.limits is not None and not self.limits[0] < self.limits[1]:
            raise ValueError(f"positions.{self.name}: limits {self.limits}, allowed a lower and a higher value")
        if self.name in RESERVED_NAMES:
            raise ValueError(f"positions.{self.name}: this name is taken by every trial")
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
    def _order(self) -> EpisodeMapping:
        if not self.from_s < self.to_s:
            raise ValueError(f"episodes: from_s = {self.from_s:g}, allowed below to_s = {self.to_s:g}")
        return self


class StrokesMapping(Table):
    """What a stroke is in a recording of positions.

    A stroke begins when any position leaves its resting level by ``trigger`` (a share of its ruler) and ends when all
    have been back within it for ``rest_s``. ``pre_s`` before and ``rest_s`` after belong to the trial.
    """

    trigger: Number = Field(default=0.15, gt=0, lt=1)
    pre_s: Number = Field(default=0.3, gt=0, le=10)
    rest_s: Number = Field(default=0.12, gt=0, le=10)
    episodes: tuple[EpisodeMapping, ...] = ()
