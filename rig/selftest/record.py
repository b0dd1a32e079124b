"""The dated record of a self-test: what was checked on the bench, what was found, whether it passed.

``pianorig selftest`` writes ``selftests/<UTC time>_<rig>.toml``; recording on hardware demands a record that passed, of
the same rig file on the same device, and recent enough.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Literal

from pydantic import ConfigDict, Field

from rig.configuration import toml_file
from rig.configuration.channels import Number, Table, Text
from rig.configuration.rig_file import Rig
from rig.errors import NotPermitted
from rig.storage.atomic_write import refused, write_text

SCHEMA: Literal["piano-action-rig selftest 1"] = "piano-action-rig selftest 1"


class SelftestFinding(Table):
    """One check: what was found, what is allowed, and what to do if it did not pass."""

    check: Text
    passed: bool = Field(strict=True)
    found: str
    allowed: str
    advice: str = ""


class SelftestRecord(Table):
    """A whole record; ``unloaded_n`` is what the force channel reads with the arm lifted off the key."""

    schema_name: Literal["piano-action-rig selftest 1"] = Field(default=SCHEMA, alias="schema")
    created_utc: datetime
    rig: Text
    rig_sha256: Text
    product: Text
    device: Text
    backend: Text
    simulated: bool = Field(strict=True)
    operator: str = "unknown"
    unloaded_n: Number | None = None
    findings: tuple[SelftestFinding, ...]

    model_config = ConfigDict(populate_by_name=True)

    @property
    def passed(self) -> bool:
        """Whether every check passed; a record without checks did not."""
        return bool(self.findings) and all(finding.passed for finding in self.findings)

    def write(self, folder: Path) -> Path:
        """Write the record into a folder, created if missing; return its path."""
        stamp = self.created_utc.astimezone(UTC)
        path = folder / f"{stamp:%Y-%m-%dT%H%M%SZ}_{self.rig}.toml"
        with refused(folder, "created"):
            folder.mkdir(parents=True, exist_ok=True)
        table = self.model_dump(by_alias=True)
        table["created_utc"] = stamp.isoformat(timespec="seconds")
        write_text(path, toml_file.dump_toml(table))
        return path


def read_record(path: Path) -> SelftestRecord:
    """Read and check one record."""
    return toml_file.check(SelftestRecord, toml_file.parse_toml(toml_file.read_text(path), str(path)), str(path))


def valid_record(rig: Rig, place: Path, now: datetime | None = None) -> tuple[Path, SelftestRecord]:
    """Find the newest record of this rig file and refuse it unless it passed and is recent enough.

    Parameters
    ----------
    place : path
        A record, or the folder of records.

    Raises
    ------
    NotPermitted
        When there is none, or the newest did not pass or is too old.
    """
    now = now or datetime.now(UTC)
    files = [place] if place.is_file() else sorted(place.glob("*.toml")) if place.is_dir() else []
    records = [(path, read_record(path)) for path in files]
    mine = [(path, record) for path, record in records if record.rig_sha256 == rig.sha256]
    if not mine:
        raise NotPermitted(
            f"{place}: no self-test of rig file {rig.source} as it is; run  pianorig selftest --rig {rig.source}"
        )
    path, record = max(mine, key=lambda item: _utc(item[1].created_utc))
    failed = [finding.check for finding in record.findings if not finding.passed]
    if not record.passed:
        raise NotPermitted(f"{path}: did not pass ({', '.join(failed) or 'no checks'}); mend it and run it again")
    age = now - _utc(record.created_utc)
    allowed_h = rig.config.safety.selftest_valid_h
    if not timedelta(0) <= age <= timedelta(hours=allowed_h):
        raise NotPermitted(
            f"{path}: self-test of {_utc(record.created_utc):%Y-%m-%d %H:%M} UTC is {age.total_seconds() / 3600:.1f} h "
            f"old, allowed 0 to {allowed_h:g} h (safety.selftest_valid_h); run  pianorig selftest  again"
        )
    return path, record


def _utc(moment: datetime) -> datetime:
    return moment.astimezone(UTC) if moment.tzinfo else moment.replace(tzinfo=UTC)
