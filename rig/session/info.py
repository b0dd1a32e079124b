"""``session.toml``: who recorded what, on which action, with which rig, in which room, with which software.

The recorder writes the file; it may be completed by hand. A value nobody measured is the word ``unknown``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, field_validator

from rig.configuration.channels import Table

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
