"""``session.toml``: who recorded what, on which action, with which rig, in which room, with which software.

The file is written by the recorder and may be completed by hand; a value nobody measured is the word
``unknown``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

SCHEMA: Literal["piano-action-rig session 1"] = "piano-action-rig session 1"
Measured = Annotated[float, Field(strict=True, allow_inf_nan=False)] | Literal["unknown"]
Digest = Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ActionInfo(_Table):
    """The action on the bench: its name, key number and what is known of its regulation and added masses."""

    name: str = "unknown"
    key: str = "unknown"
    regulation: str = "unknown"
    added_masses: str = "unknown"


class FileInfo(_Table):
    """A file the session was made with: its name, the copy kept beside it, the SHA-256 of its text."""

    name: str
    copy_name: str = ""
    sha256: Digest = ""


class PlanInfo(_Table):
    """What was to be recorded."""

    trials: Annotated[int, Field(strict=True, ge=1)] = 1


class RoomInfo(_Table):
    """The room: each value in SI-derived units, or ``unknown``."""

    temperature_c: Measured = "unknown"
    relative_humidity_percent: Measured = "unknown"


class SessionInfo(_Table):
    """Contents of ``session.toml``."""

    schema_name: Literal["piano-action-rig session 1"] = Field(default=SCHEMA, alias="schema")
    name: str = ""
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

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    def to_table(self) -> dict[str, Any]:
        """Return nested plain values, ready for TOML."""
        return self.model_dump(by_alias=True)
